"""Which engine eqt takes where a configuration names none, what it says, and that it stays."""

import json
import pickle
from pathlib import Path

import pytest
from case_tables import from_yaml
from said import says
from small_experiment import configuration

from eqt_cli.base.errors import ConfigError, EqtError
from eqt_cli.base.files import read_record, write_record
from eqt_cli.config.document import read_config
from eqt_cli.config.study import add_grids, study
from eqt_cli.engines import compiler, native
from eqt_cli.engines.native import Native, programs
from eqt_cli.results.result import open_result

pytestmark = [
    pytest.mark.filterwarnings("ignore:engine solve_ivp, about:UserWarning"),
    pytest.mark.skipif(Native.unavailable() is not None, reason="needs a C compiler"),
]

NO_COMPILER = (
    "engine solve_ivp, 2 to 17 times slower than native: engine native needs a C compiler: install "
)
LAW = """
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.extend import EqT


@dataclass(frozen=True)
class Own(EqT):
    name: ClassVar[str] = "own"
    by: str = "eqt"

    def torque(self, s):
        return super().torque(s) if self.by == "eqt" else np.array(super().torque(s), float)
"""


@pytest.fixture(autouse=True)
def _in_a_folder(folder, monkeypatch):
    monkeypatch.delenv("EQT_ENGINE")
    monkeypatch.delenv("CC", raising=False)
    Path("c.yaml").write_text(configuration(), encoding="utf-8")
    Path("own.py").write_text(LAW, encoding="utf-8")


@pytest.fixture
def without_compiler(monkeypatch):
    """As a machine that has none; with `back`, one again."""

    def gone(*, back=False):
        monkeypatch.setattr(compiler, "commands", there if back else list)

    there = compiler.commands
    return gone


def read(*overrides, grids=(), **changes):
    Path("c.yaml").write_text(configuration(**changes), encoding="utf-8")
    blocks = {f"grids[{index}]": grid for index, grid in enumerate(grids)}
    return study(add_grids(read_config(Path("c.yaml"), overrides), blocks))


def own(by):
    return {"controllers": f"[{{kind: own, by: {by}}}]", "plugins": "[own.py]"}


# What is chosen -----------------------------------------------------------------------------------


@pytest.mark.parametrize("written", [[], ["solver.engine=auto"]])
def test_with_a_compiler_it_is_native_and_nothing_is_said(written, told):
    chosen = read(*written)
    assert (
        chosen.resolved["solver"]["engine"] == chosen.document.data["solver"]["engine"] == "native"
    )
    assert chosen.digest == read("solver.engine=native").digest
    assert chosen.resolved == read("solver.engine=native").resolved
    assert told.remarks == []


def test_without_a_compiler_it_is_solve_ivp_and_says_why(without_compiler, told):
    without_compiler()
    assert read().digest == read("solver.engine=solve_ivp").digest
    [remark] = told.remarks
    assert remark.startswith(NO_COMPILER)


def test_a_compiler_that_does_not_work_is_none(monkeypatch, told):
    monkeypatch.setenv("CC", "/nowhere/cc")
    assert read().base.engine.name == "solve_ivp"
    assert told.remarks == [
        "engine solve_ivp, 2 to 17 times slower than native: the C compiler /nowhere/cc cannot be "
        "started: No such file or directory; set the variable CC to a C compiler, or remove it"
    ]


def test_a_law_that_cannot_be_compiled_is_called(told):
    assert read(**own("eqt")).base.engine.name == "native"
    assert read(**own("numpy")).base.engine.name == "solve_ivp"
    [remark] = told.remarks
    assert remark.startswith(
        "engine solve_ivp, 2 to 17 times slower than native: controller 'own' cannot be compiled: "
        "TypeError: float() argument must be"
    )
    assert remark.endswith("or use `engine: solve_ivp`")
    named = read("solver.engine=native", **own("numpy"))  # which never gives way
    with pytest.raises(EqtError, match="cannot be compiled"):
        programs(named.base.loop)


def test_what_no_compiler_ends_is_called_and_says_how_long_it_is(monkeypatch, told):
    monkeypatch.setattr(native, "MOST_OPERATIONS", 100)
    programs.cache_clear()
    assert read().base.engine.name == "solve_ivp"
    [remark] = told.remarks
    assert "operations at a time; beyond 100, a C compiler takes more than a minute" in remark
    programs.cache_clear()


@pytest.mark.parametrize(
    ("grids", "engine"),
    [
        (["controllers[0].by=eqt,numpy", "gains.kd=0.5,1"], "solve_ivp"),
        (["controllers[0].by=eqt", "gains.kd=0.5,1"], "native"),
    ],
)
def test_all_points_of_a_sweep_have_one_engine(grids, engine, told):
    swept = read(grids=grids, **own("eqt"))
    names = {swept.experiment(point).engine.name for point in range(len(swept))}
    assert names == {engine}
    assert swept.digest == read(f"solver.engine={engine}", grids=grids, **own("eqt")).digest
    assert len(told.remarks) == (engine == "solve_ivp")


@from_yaml
def test_a_sweep_of_the_solver_names_its_engines(grid, message):
    with pytest.raises(ConfigError) as caught:
        read(grids=[grid])
    [problem] = caught.value.problems
    assert says(f"{problem.path}: {problem.message}", message)


@pytest.mark.parametrize(
    ("key", "engine"), [("method=RK45", "solve_ivp"), ("block=1", "solve_ivp")]
)
def test_a_key_of_one_engine_needs_its_name(key, engine):
    name = key.partition("=")[0]
    with pytest.raises(ConfigError) as caught:
        read(f"solver.{key}")
    assert [f"{each.path}: {each.message}" for each in caught.value.problems] == [
        f"solver.{name}: is a key of engine {engine}; add engine: {engine}"
    ]
    assert read(f"solver.{key}", f"solver.engine={engine}").base.engine.name == engine


def test_the_environment_has_precedence_where_nothing_is_written(monkeypatch):
    monkeypatch.setenv("EQT_ENGINE", "solve_ivp")
    assert read().base.engine.name == "solve_ivp"
    assert not read().base.solver.is_auto
    assert read("solver.engine=auto").base.engine.name == "native"


# What was chosen stays ----------------------------------------------------------------------------


def engine_of(folder):
    record = json.loads(Path(folder, "manifest.json").read_text(encoding="utf-8"))
    with open_result(Path(folder)) as result:
        held = read_config(Path(folder)).data["solver"]["engine"]
        assert result.attributes["digest"] == record["digest"]
    assert record["config"]["solver"]["engine"] == held
    return held


def test_a_result_has_the_engine_that_computed_it(eqt, without_compiler):
    assert eqt("run", "c.yaml", "--out", "fast", "--quiet").code == 0
    assert eqt("run", "c.yaml", "--out", "named", "--engine", "native", "--quiet").code == 0
    without_compiler()
    said = eqt("run", "c.yaml", "--out", "slow", "--set", "solver.cross_check=1")
    assert said.code == 0
    assert said.err.count(NO_COMPILER) == 1
    assert list(map(engine_of, ("fast", "named", "slow"))) == ["native", "native", "solve_ivp"]
    with open_result(Path("fast")) as fast, open_result(Path("named")) as named:
        assert (fast["pose"] == named["pose"]).all()
    without_compiler(back=True)
    assert eqt("run", "slow", "--out", "again", "--quiet").code == 0
    assert engine_of("again") == "solve_ivp"


def test_a_chosen_native_is_checked_by_the_other_method(run):
    with open_result(run("solver.engine=auto", "solver.cross_check=1").folder.path) as result:
        assert result.cross_check.method.startswith("extrapolation")
        assert result.cross_check.holds


def test_a_folder_goes_on_by_the_engine_that_began_it(eqt, without_compiler):
    without_compiler()
    shard = ("run", "c.yaml", "--out", "out", "--shard")
    assert eqt(*shard, "1/2").code == 0
    without_compiler(back=True)
    done = eqt(*shard, "2/2")
    assert (done.code, done.err) == (
        0,
        "eqt: warning: out: goes on by engine solve_ivp, which began it\n",
    )
    assert eqt("pack", "out").code == 0
    assert engine_of("out") == "solve_ivp"
    assert eqt("run", "c.yaml", "--out", "out", "--force", "--quiet").code == 0
    assert engine_of("out") == "native"


def test_a_folder_of_native_is_not_continued_without_a_compiler(eqt, without_compiler):
    assert eqt("run", "c.yaml", "--out", "out", "--shard", "1/2").code == 0
    without_compiler()
    done = eqt("run", "c.yaml", "--out", "out", "--shard", "2/2", "--quiet")
    assert (done.code, done.out) == (2, "")
    assert says(done.err, "eqt: error: out: was begun by…native…needs a C compiler…--out\n")


def test_another_experiment_is_named_without_its_engine(eqt):
    assert eqt("run", "c.yaml", "--out", "out", "--engine", "solve_ivp").code == 0
    done = eqt("run", "c.yaml", "--out", "out", "--set", "gains.kp=2")
    assert done.code == 2
    assert "  gains.kp: 1.0 there, 2.0 here\n" in done.err
    assert "solver." not in done.err


def test_a_worker_never_chooses_again(without_compiler):
    sent = pickle.dumps(read(grids=["gains.kp=1,2"]))
    without_compiler()
    with pytest.raises(ConfigError, match="engine native needs a C compiler"):
        pickle.loads(sent)


WORST = """{over: {gains.kp: [1, 2]}, objective: mean_torque, budget: 1, population: 5, seeds: 1,
  profile: {points: 2}}"""


@pytest.mark.needs("search")
def test_a_search_goes_on_by_the_engine_that_began_it(eqt, without_compiler):
    Path("c.yaml").write_text(configuration(worst=WORST, controllers="[gt]"), encoding="utf-8")
    command = ("worst", "c.yaml", "--out", "out", "--set", "ensemble.runs=1")
    without_compiler()
    assert eqt(*command).code == 0
    found = json.loads(Path("out/worst.json").read_text(encoding="utf-8"))
    assert found["engine"] == "solve_ivp"
    without_compiler(back=True)
    done = eqt(*command)
    assert done.code == 0
    assert "eqt: warning: out: goes on by engine solve_ivp, which began it\n" in done.err
    assert json.loads(Path("out/worst.json").read_text(encoding="utf-8")) == found


def test_a_broken_record_of_a_folder_names_no_engine(eqt):
    assert eqt("run", "c.yaml", "--out", "out", "--quiet").code == 0
    for wrong in (3, {"solver": 3}, {"solver": {"engine": ["native"]}}):
        record = read_record(Path("out/manifest.json"), "digest")
        write_record(Path("out/manifest.json"), record | {"config": wrong})
        assert eqt("run", "c.yaml", "--out", "out", "--quiet").code == 0
