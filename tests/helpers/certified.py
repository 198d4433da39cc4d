"""Certificates of laws without a run."""

from types import SimpleNamespace

from uvms_mj.control.certificate import Certificate
from uvms_mj.control.task import ImpedanceTask


def certificate_of(law) -> Certificate:
    """The certificate of a law with the default gains of s."""
    return law.certificate(SimpleNamespace(task=ImpedanceTask()))
