"""Files that travel with the package: vehicle models and scenarios."""

from pathlib import Path

_PACKAGE = Path(__file__).parent
_FOLDERS = {
    "scenarios": (_PACKAGE / "scenarios",),
    "models": (_PACKAGE / "models", _PACKAGE.parents[1] / "models"),  # in the wheel; in a checkout
}


def resource(kind: str, file_name: str) -> Path | None:
    """Path of a file that ships, or None. ``kind`` is "scenarios" or "models"."""
    if Path(file_name).name != file_name:
        return None
    return next((f / file_name for f in _FOLDERS[kind] if (f / file_name).is_file()), None)


def names(kind: str, suffix: str) -> list[str]:
    """Names, without suffix, of what ships."""
    return sorted({path.stem for folder in _FOLDERS[kind] for path in folder.glob(f"*{suffix}")})
