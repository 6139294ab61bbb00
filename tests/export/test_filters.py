"""The filter of a law as C, against eqt's own."""

import pytest
from exported_laws import checked, compilers, made, written

from eqt_cli.analysis.evidence.program_error import ARITHMETICS
from eqt_cli.core.errors import EqtError
from eqt_cli.exporting.laws import exported


def filtered(kind, real="double", **timing):
    """A law with memory on SO(3), which reads an estimate."""
    pose = {"kind": "noise", "std": 0.02, "period": 0.2, "dropout": 0.3, **timing}
    velocity = [{"kind": "noise", "std": 0.01}, {"kind": "bias", "value": 0.05}]
    sensors, estimator = {"pose": [pose], "velocity": velocity}, {"kind": kind}
    config = made("SO3", ["goodarzi2013"], sensors=sensors, estimator=estimator)
    [found] = exported(config, [], ARITHMETICS[real])
    return found


@pytest.mark.skipif(not compilers(), reason="no C compiler")
@pytest.mark.parametrize(
    ("kind", "real"),
    [
        ("invariant", "double"),
        pytest.param("complementary", "double", marks=pytest.mark.slow("one of each is fast")),
        pytest.param("eqf", "float", marks=pytest.mark.slow("one of each is fast")),
    ],
)
def test_a_filter_in_c_estimates_what_eqt_estimates(tmp_path, kind, real):
    law = filtered(kind, real)
    folder, compiler = written(law, tmp_path / "c"), compilers()[0]
    code, said = checked(law, folder, compiler)
    assert (code, " states pass; " in said) == (0, True), said
    source = folder / f"{law.name}.c"
    text = source.read_text(encoding="utf-8")
    kept = "*filter = next;"
    off = "0.1" if real == "float" else "1e-6"
    spoiled = text.replace(kept, f"{kept} filter->bias[0] += {off};")
    source.write_text(spoiled, encoding="utf-8")
    code, said = checked(law, folder, compiler)
    assert code == 1
    assert said.startswith(f"{law.name}: filter, instant 1 of 40: number ")


def test_a_filter_whose_measurements_arrive_late_is_refused():
    with pytest.raises(EqtError) as error:
        filtered("eqf", delay=1)
    assert str(error.value) == (
        "goodarzi2013: a filter whose measurements arrive late is not written as C; remove `delay` "
        "from the sensors, or the key estimator"
    )
