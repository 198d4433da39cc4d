"""The command line in this process."""

import pytest
from click.testing import CliRunner

from uvms_mj.cli import main


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A function that runs the command in this process and returns exit code, standard output and standard error."""
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: CliRunner().invoke(main, [str(a) for a in arguments])
