"""Study files."""

import pytest

from short_study import study_text


@pytest.fixture
def study_file(tmp_path):
    """A function that writes a study file and returns its path."""

    def write(name="s.toml", **lines):
        path = tmp_path / name
        path.write_text(study_text(**lines))
        return path

    return write
