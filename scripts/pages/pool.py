"""Draw docs/pool.png, the pitch of every trial, from the records of the pool.

python scripts/pages/pool.py pool_2023
"""

from pathlib import Path

import click

from uvms_mj.studies.study import executor_of
from uvms_mj.studies.validate import figures
from uvms_mj.studies.validate.data import records
from uvms_mj.studies.validate.results import compute

PICTURE = Path(__file__).parents[2] / "docs" / "pool.png"


@click.command()
@click.argument("folder", type=click.Path(exists=True, path_type=Path))
def main(folder: Path) -> None:
    """Draw docs/pool.png from the records in FOLDER."""
    with executor_of(None, None) as executor:
        results = compute(*records(folder), executor, lambda done, total: None)
    figures.pitches(results).savefig(PICTURE, dpi=100)


if __name__ == "__main__":
    main()
