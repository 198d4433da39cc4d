"""Commands that list keys and signals."""

from uvms_mj.stages.signals import GIVEN, RECORDED


def test_keys_and_signals_list_all(here):
    text = "".join(here("keys").stdout.split())
    for word in ("controller.period", "controller.F_1", "controller.integral", "{time=1.0,position=[1.01"):
        assert word in text
    text = here("signals").stdout
    for each in (*GIVEN, *RECORDED):
        assert each.name in text
