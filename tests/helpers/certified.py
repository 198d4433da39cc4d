"""Certificates of laws without a run."""

from types import SimpleNamespace

from uvms_mj.control.certificate import Certificate


def certificate_of(law) -> Certificate:
    """The certificate of a law with its own gains of s."""
    return law.certificate(SimpleNamespace(task=law))
