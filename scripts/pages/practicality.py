"""Draw docs/practicality.png, the maps of the page, from the folder of `uvms-mj practicality`.

uvms-mj practicality --out real
python scripts/pages/practicality.py real
"""

from pathlib import Path

import click

from uvms_mj.studies.practicality import figures
from uvms_mj.studies.practicality.plans import plans
from uvms_mj.studies.practicality.results import Results
from uvms_mj.studies.results import frame

PICTURE = Path(__file__).parents[2] / "docs" / "practicality.png"


@click.command()
@click.argument("folder", type=click.Path(exists=True, path_type=Path))
def main(folder: Path) -> None:
    """Draw docs/practicality.png from FOLDER."""
    planned = plans({})
    results = Results(planned, {name: frame(folder / name) for name in planned})
    figures.maps(results).savefig(PICTURE, dpi=120)


if __name__ == "__main__":
    main()
