"""Colours of runs."""

from uvms_mj.views import colours


def test_colours_of_runs_are_different_and_a_law_keeps_its_own():
    alone = {law: colours.of_runs([law])[0] for law in colours.LAWS}
    assert len(set(alone.values())) == len(alone)
    assert dict(zip(alone, colours.of_runs(list(alone)), strict=True)) == alone
    sweep = colours.of_runs(["gsta"] * 20 + ["a.py:A", "b.py:B"] + ["fosm"])
    assert len(set(sweep)) == 23
    assert sweep[-1] == alone["fosm"]
