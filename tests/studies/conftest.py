"""Study files."""

import os

import pytest

from short_study import study_text


@pytest.fixture(autouse=True)
def _not_on_the_disk_yet(monkeypatch):
    """A file is whole when it has its name; whether a loss of power spares it is not tested, and costs time."""
    monkeypatch.setattr(os, "fsync", lambda file: None)


@pytest.fixture
def study_file(tmp_path):
    """A function that writes a study file and returns its path."""

    def write(name="s.toml", **lines):
        path = tmp_path / name
        path.write_text(study_text(**lines))
        return path

    return write
