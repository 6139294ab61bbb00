"""Words that people search for lead to a page and a command that are there."""

import re
import shlex
from pathlib import Path

import pytest

from eqt_cli.base.extensions import all_kinds
from eqt_cli.base.registry import registry
from eqt_cli.cli.app import COMMANDS
from eqt_cli.config import shipped
from eqt_cli.extensions.topics.topics import hint, topics, topics_for

DOCS = Path(__file__).parents[3] / "docs"

WORDS = {
    "bandwidth": "howto/gains.md",
    "misalignment": "howto/vehicle.md",
    "ARW": "howto/budget.md#numbers-of-a-data-sheet",
    "bias instability": "howto/budget.md#numbers-of-a-data-sheet",
    "keep-out": "howto/spacecraft.md",
    "SDF": "howto/vehicle_files.md",
    "px4": "howto/autopilots.md",
    "x500": "howto/vehicle_files.md",
    "saturation": "howto/limits.md",
    "error budget": "howto/budget.md",
    "3-sigma": "howto/budget.md",
    "Monte Carlo": "howto/change.md",
    "gain margin": "howto/margins.md",
    "domain randomisation": "howto/change.md",
    "sim-to-real": "howto/network.md",
    "rank my law": "howto/suite.md",
    "train a policy": "howto/train.md",
    "GPU": "howto/train.md",
    "install": "install.md",
    "cluster": "howto/clusters.md",
    "autocompletion": "howto/editor.md",
    "YAML schema": "howto/editor.md",
    "degrees": "howto/change.md#write-units",
    "phone": "howto/compare.md#send-a-report",
    "citing": "cite.md",
    "failed_when": "howto/failures.md",
    "ocean current": "howto/marine.md",
    "path coloured by error": "howto/figures.md",
    "where does it fail": "howto/failures.md",
    "one more run": "howto/sweeps.md#more-points-laws-or-runs",
    "resume": "howto/messages.md#after-an-interruption",
    "tensor": "howto/vehicle.md",
    "hexarotor": "howto/rotors.md",
    "clamp": "howto/limits.md",
    "integral gain": "howto/limits.md",
    "torque saturation": "howto/limits.md",
    "block diagram": "howto/diagram.md",
    "gnss": "howto/navigation.md",
    "imu": "howto/navigation.md",
    "sun": "howto/spacecraft.md",
    "orbit": "howto/spacecraft.md",
    "nees": "howto/estimate.md",
    "budget": "howto/budget.md",
    "keep_out": "howto/spacecraft.md",
}


@pytest.mark.parametrize(("word", "page"), WORDS.items())
def test_a_word_leads_to_its_page(word, page):
    assert page in [topic.page for topic in topics_for(word)]
    assert topics_for(word) == topics_for(word.upper().replace("-", " "))


def test_parts_of_phrases_are_enough_and_other_words_lead_nowhere():
    assert [topic.page for topic in topics_for("tune gains fair")] == ["howto/tune.md"]
    assert topics_for("xyzzy") == topics_for("a") == []
    assert hint("swep") == ""  # a slip is no word


@pytest.mark.ci("imports all components")
@pytest.mark.parametrize("topic", topics(), ids=lambda topic: topic.want)
def test_a_topic_names_a_page_and_a_command_that_are_there(topic):
    page, _, anchor = topic.page.partition("#")
    headings = re.findall(r"^#+ (.*)", (DOCS / page).read_text(encoding="utf-8"), re.M)
    ids = [re.sub(r"[^\w -]", "", line).strip().lower().replace(" ", "-") for line in headings]
    assert not anchor or anchor in ids
    eqt, command, name, *_ = shlex.split(topic.command)
    assert (eqt, command in COMMANDS) == ("eqt", True)
    if command == "run":
        assert name == "mine.yaml" or name in shipped.names()
    if command == "list":
        names = {each for kind in all_kinds() for each in registry(kind).names()}
        assert name in {*names, *all_kinds()}


def test_no_word_stands_in_more_than_two_topics():
    words = [word.casefold() for topic in topics() for word in topic.words]
    assert max(map(words.count, words)) <= 2
    assert all(len(set(topic.words)) == len(topic.words) for topic in topics())


@pytest.mark.ci("imports all components")
def test_list_tells_topics_and_components_of_a_word(invoke):
    said = invoke("list", "gnss").stdout
    assert "docs/howto/navigation.md" in said
    assert "eqt run quadrotor_gnss" in said
    assert re.search(r"estimators +navigation", said)
    assert "docs/howto/spacecraft.md" in invoke("list", "keep_out").stdout
    assert "docs/howto/compare.md" in invoke("list", "rank", "my", "law").stdout  # no quotes
    assert "unknown kind or component 'xyzzy'" in invoke("list", "xyzzy", code=2).stderr


def test_an_unknown_command_is_told_where_its_word_leads(invoke):
    said = invoke("resume", code=2).stderr
    assert "unknown command 'resume'" in said
    assert "docs/howto/messages.md#after-an-interruption" in said
    assert "did you mean 'sweep'" in invoke("swep", code=2).stderr
