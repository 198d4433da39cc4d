"""Files shipped with the package: vehicle models and scenarios."""

from pathlib import Path

_PACKAGE = Path(__file__).parent
_FOLDERS = {
    "scenarios": (_PACKAGE / "scenarios",),
    "models": (_PACKAGE / "models", _PACKAGE.parents[1] / "models"),  # in a wheel; in a checkout
}


def resource(kind: str, file_name: str) -> Path | None:
    """Path of a shipped file, or None if there is no such file. ``kind`` is "scenarios" or "models"."""
    if Path(file_name).name != file_name:
        return None
    return next((f / file_name for f in _FOLDERS[kind] if (f / file_name).is_file()), None)


def names(kind: str, suffix: str) -> list[str]:
    """Names, without suffix, of the shipped files of a kind."""
    return sorted({path.stem for folder in _FOLDERS[kind] for path in folder.glob(f"*{suffix}")})
