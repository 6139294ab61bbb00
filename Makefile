# From a bare Python to the paper's figure. Targets that need an environment build .venv first,
# and again whenever pyproject.toml changes.

VENV := .venv
LOWEST := .venv-lowest
BIN := $(VENV)/bin
PIP := python -m pip --quiet --disable-pip-version-check
# The interpreter a new environment is built from: PYTHON, or else the first new enough of these.
PYTHON ?=
PYTHONS := $(or $(PYTHON),python3 python3.14 python3.13 python3.12 python3.11)
# Set, as in the jobs of continuous integration: installs what .ci/lock*.txt name, by version and hash.
LOCKED ?=
HASHED := install --no-deps --require-hashes --requirement .ci/lock
# Extra arguments for pytest: make test ARGS='-k groups'
ARGS ?=

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help paper wheel figures figures-check notebooks sheets suite suite-again validate test test-core test-all test-lowest alone tiers faults fuzz mutants oracles bench check lock hooks format reference docs clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-13s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)
	@echo "A new .venv uses the first Python >= 3.11 found; make PYTHON=/path/to/python ... names another."

paper: $(VENV)/.stamp-base ## run the paper's experiment, draw its figure and compare its laws, in results/paper
	$(BIN)/eqt run configs/paper.yaml --out results/paper
	$(BIN)/eqt plot results/paper
	$(BIN)/python docs/figures/printed.py draw results/paper
	$(BIN)/eqt compare results/paper
	@echo
	@echo "all runs          results/paper/results.h5"
	@echo "figure            results/paper/figures/paper.pdf (.svg, .png)"
	@echo "next              $(BIN)/eqt report results/paper"
	@echo "your own          $(BIN)/eqt config new mine.yaml --from paper"

figures: $(VENV)/.stamp-figures ## draw every figure of the documentation anew, in docs/figures
	EQT=$(BIN)/eqt PYTHON=$(BIN)/python docs/figures/draw.sh draw

figures-check: $(VENV)/.stamp-figures ## compare the numbers behind the figures with those in docs/figures
	EQT=$(BIN)/eqt PYTHON=$(BIN)/python docs/figures/draw.sh check

notebooks: $(VENV)/.stamp-base ## execute the notebooks of examples, and store their output
	$(BIN)/$(PIP) install --group notebook --editable '.[xarray]'
	$(BIN)/python tests/shared/notebooks.py

sheets: $(VENV)/.stamp-base ## draw sheets of every figure in build/sheets: colour, grey, two colour blindnesses
	$(BIN)/python docs/figures/sheets.py build/sheets $(ARGS)

# Searches that results/suite holds are used again. ARGS='--laws eqt,gt --out part.zip' computes some only.
suite: $(VENV)/.stamp-base ## compute the archive of `eqt suite` anew, in its extension: 20 CPU minutes
	$(BIN)/eqt suite archive $(ARGS)

suite-again: $(VENV)/.stamp-base ## tune the archive's laws on other training samples; no verdict may be reversed: 20 CPU minutes
	$(BIN)/eqt suite repeat $(ARGS)

# As the commands: threads of BLAS only wait for each other where matrices are small.
test test-core test-all test-lowest tiers faults fuzz: export OPENBLAS_NUM_THREADS = 1

test: $(VENV)/.stamp-test ## run the quick tests, which call every function that is tested quickly: 2 minutes
	@$(if $(ARGS),,echo "Running the quick tests: 2 minutes of two cores")
	$(BIN)/python -m pytest -n auto --dist worksteal -m 'not ci' $(ARGS)

# In a copy without the folder, so that nothing of it can be found.
test-core: $(VENV)/.stamp-test ## run the quick tests of the core without extensions/: 2 minutes
	rm -rf build/core
	mkdir -p build/core
	git ls-files -z | grep -zv '^eqt_cli/extensions/' | xargs -0 cp --parents --target-directory=build/core
	cd build/core && PYTHONPATH=$(CURDIR)/build/core $(CURDIR)/$(BIN)/python -m pytest -n auto --dist worksteal -m 'not ci' $(ARGS)

SHARE ?= full
test-all: $(VENV)/.stamp-test ## run all tests; SHARE=3/8: of cases like quick ones a share; ARGS='-m ci': only others
	EQT_SHARE=$(filter-out full,$(SHARE)) $(BIN)/python -m pytest -n auto --dist worksteal $(ARGS)

alone: $(VENV)/.stamp-test ## takes away one extension after the other; the places of the others must import, and commands answer
	$(BIN)/python -m pytest -n auto -m ci tests/base/test_alone.py $(ARGS)

tiers: $(VENV)/.stamp-test ## measure all tests and choose the quick ones, in tests/tiers.tsv (needs Python 3.12)
	rm -rf build/tiers
	XDG_CACHE_HOME=$(CURDIR)/build/tiers/cache EQT_TIERS=off EQT_MEASURE=build/tiers $(BIN)/python -m pytest -n auto --dist worksteal -m 'not ci' $(ARGS)
	$(BIN)/python tests/shared/choose_tiers.py build/tiers

test-lowest: $(LOWEST)/.stamp ## run all tests on the oldest supported versions (needs python3.11)
	$(LOWEST)/bin/python -m pytest -n auto --dist worksteal $(ARGS)

faults: $(VENV)/.stamp-test ## kill runs and sweeps at 500 random moments; SHARE=tenth: at 50
	EQT_FAULTS=$(SHARE) $(BIN)/python -m pytest -n auto --dist worksteal tests/faults $(ARGS)

fuzz: $(VENV)/.stamp-test ## try 10,000 mutated configurations and 5,000 results (minutes); test-all does a fortieth
	EQT_FUZZ=full $(BIN)/python -m pytest -n auto --dist worksteal tests/fuzz $(ARGS)

oracles: $(VENV)/.stamp-test ## compare with Basilisk, MuJoCo, Pinocchio, RotorPy and python-control, which it installs
	$(BIN)/$(PIP) $(if $(LOCKED),$(HASHED)-oracles.txt,install --group oracles)
	$(BIN)/$(PIP) $(if $(LOCKED),$(HASHED)-basilisk.txt,install --no-deps --group basilisk)
	$(BIN)/python -m pytest tests/components/test_oracles.py tests/extensions/thrusters/test_rotors.py tests/components/test_basilisk.py \
		tests/extensions/designed_laws/test_lqr.py tests/extensions/vehicles/test_mjcf_motion.py $(ARGS)

# Goes on where it was stopped; ARGS='--seed 2 --count 100', or '--only metrics --again'
mutants: $(VENV)/.stamp-test ## plant small faults in the mathematical core; its tests must tell 95 % of 300
	PYTHONPATH=tests/shared $(BIN)/python -m mutants $(ARGS)

# The commit before signals were compiled; make bench BEFORE=HEAD^ compares with another one.
BEFORE ?= 7cbc8f6^
# diffrax, heyoka, MuJoCo and RotorPy take part where they are installed: .venv/bin/python -m pip install --group bench
# Crazyflow and Basilisk require other versions, and so a Python of their own: make bench ARGS='--others PYTHON'
# Some parts only: make bench ARGS='--part commands --part profile --many 10000'
bench: $(VENV)/.stamp-base ## measure eqt against other ways to integrate and an earlier commit
	$(BIN)/python -m benchmarks --before '$(BEFORE)' $(ARGS)

validate: $(VENV)/.stamp-base ## repeat the studies of public flights, DATA=folder of their repositories: half an hour
	$(BIN)/python -m benchmarks.flights '$(DATA)' $(ARGS)

check: $(VENV)/.stamp-lint ## format, lint, types, import layering, names, scripts of pages, subjects of commits
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo
	$(BIN)/python .ci/names
	.ci/javascript/check
	.ci/subjects

COMPILE = $(BIN)/python -m uv pip compile --quiet --no-header --no-annotate --upgrade --universal \
	--python-version 3.11 --generate-hashes pyproject.toml
lock: $(VENV)/.stamp-base ## write the versions and hashes that continuous integration installs, in .ci
	$(BIN)/$(PIP) install uv
	$(COMPILE) --extra all --group test --group lint --group docs --group release --group ci --output-file .ci/lock.txt
	$(COMPILE) --group oracles --constraint .ci/lock.txt --output-file .ci/lock-oracles.txt
	$(COMPILE) --group notebook --constraint .ci/lock.txt --output-file .ci/lock-notebook.txt
	$(subst pyproject.toml,,$(COMPILE)) --no-deps --group basilisk --output-file .ci/lock-basilisk.txt
	$(COMPILE) --extra all --extra native --group test --constraint tests/lowest.txt --output-file .ci/lock-lowest.txt

hooks: ## check the subject of each of your commits before it is made
	mkdir -p "$$(git rev-parse --git-path hooks)"
	printf '#!/bin/sh\nexec .ci/subjects "$$1"\n' > "$$(git rev-parse --git-path hooks)/commit-msg"
	chmod +x "$$(git rev-parse --git-path hooks)/commit-msg"

format: $(VENV)/.stamp-lint ## format the code and mend what ruff can mend
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .
	.ci/javascript/check --write

reference: $(VENV)/.stamp-base ## write what the program knows into the pages of docs/reference
	$(BIN)/python docs/reference/generate.py

# -E: docstrings change, which Sphinx cannot see.
docs: $(VENV)/.stamp-docs ## build the documentation, in build/docs
	$(BIN)/python docs/reference/generate.py --check
	$(BIN)/python docs/_ext/words.py
	$(BIN)/python -m sphinx --quiet -E -W --keep-going --nitpicky -d build/doctrees docs build/docs
	@echo "build/docs/index.html"

# ARGS='--constraint tests/lowest.txt' tries the oldest supported versions.
wheel: $(VENV)/.stamp-base ## build dist/ and run the commands from the wheel alone, without extras and network
	$(if $(LOCKED),,$(BIN)/$(PIP) install --group release)
	rm -rf dist
	$(BIN)/python -m build --quiet $(if $(LOCKED),--no-isolation) --outdir dist
	$(BIN)/python -m twine check --strict dist/*
	$(BIN)/python -m build --quiet --wheel $(if $(LOCKED),--no-isolation) --outdir dist/example examples/package
	PYTHON=$(BIN)/python tests/from_the_wheel.sh dist/*.whl $(ARGS)

clean: ## remove caches and builds; .venv and results stay
	rm -rf build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
	find eqt_cli tests -name __pycache__ -type d -prune -exec rm -rf {} +

# $(call venv,FOLDER,INTERPRETERS): an environment with a pip that reads dependency groups.
define venv
@set -eu; \
if ! $(1)/bin/python -m pip --version >/dev/null 2>&1; then \
	found=; seen=; \
	for python in $(2); do \
		version=$$($$python --version 2>/dev/null) || continue; \
		seen="$$seen $$python ($$version)"; \
		if $$python -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then \
			found=$$python; break; \
		fi; \
	done; \
	if [ -z "$$found" ]; then \
		echo "eqt needs Python 3.11 or newer. Looked for: $(2). Found:$${seen:- none}." >&2; \
		echo "Install one, or name it: make PYTHON=/path/to/python3.12 $(MAKECMDGOALS)" >&2; \
		exit 1; \
	fi; \
	if ! $$found -c 'import ensurepip, venv' 2>/dev/null; then \
		name=$${found##*/}; \
		case $$name in python3*) ;; *) name=python3 ;; esac; \
		echo "$$found lacks its venv module. On Debian or Ubuntu, install it and run make again:" >&2; \
		echo "    sudo apt install $$name-venv" >&2; \
		exit 1; \
	fi; \
	echo "Setting up $(1) with $$found ($$($$found --version))"; \
	$$found -m venv --clear $(1); \
	echo '*' > $(1)/.gitignore; \
fi
@$(if $(LOCKED),,$(1)/bin/$(PIP) install 'pip>=25.1')
endef

# A compiler in a wheel, for the engine `native` of the tests where the machine has none.
NATIVE := $(if $(shell command -v $${CC:-cc} || command -v clang || command -v gcc),,,native)

$(VENV)/.stamp-base: pyproject.toml
	$(call venv,$(VENV),$(PYTHONS))
	@echo "Installing eqt into $(VENV): 85 MB to download, 400 MB on disk, a minute"
	@$(BIN)/$(PIP) $(if $(LOCKED),$(HASHED).txt,install --editable .)
	@$(if $(LOCKED),$(BIN)/$(PIP) install --no-deps --no-build-isolation --editable .)
	@touch $@

$(VENV)/.stamp-test: $(VENV)/.stamp-base
	@echo "Installing what the tests need into $(VENV): 50 MB more to download, 800 MB on disk in all, a minute"
	@$(if $(LOCKED),,$(BIN)/$(PIP) install --group test --editable '.[all$(NATIVE)]')
	@touch $@

$(VENV)/.stamp-lint: $(VENV)/.stamp-test
	@echo "Installing ruff, mypy and import-linter into $(VENV)"
	@$(if $(LOCKED),,$(BIN)/$(PIP) install --group lint)
	@touch $@

$(VENV)/.stamp-figures: $(VENV)/.stamp-base
	@echo "Installing Clarabel into $(VENV), which proves rates"
	@$(if $(LOCKED),,$(BIN)/$(PIP) install --editable '.[certify]')
	@touch $@

$(VENV)/.stamp-docs: $(VENV)/.stamp-base
	@echo "Installing what builds the documentation into $(VENV)"
	@$(if $(LOCKED),,$(BIN)/$(PIP) install --group docs --editable '.[all]')
	@touch $@

$(LOWEST)/.stamp: pyproject.toml tests/lowest.txt
	$(call venv,$(LOWEST),$(or $(PYTHON),python3.11))
	@echo "Installing the oldest supported versions into $(LOWEST)"
	@$(LOWEST)/bin/$(PIP) $(if $(LOCKED),$(HASHED)-lowest.txt,install --constraint tests/lowest.txt --group test --editable '.[all,native]')
	@$(if $(LOCKED),$(LOWEST)/bin/$(PIP) install --no-deps --no-build-isolation --editable .)
	@touch $@
