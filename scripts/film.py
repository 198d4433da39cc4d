"""Make the moving picture of the README, docs/push.gif, as a reader would:

uvms-mj run --out results
uvms-mj video results/run.mcap --out docs/push.gif --from 0.5 --to 10 --fps 20 --plots force,position
"""

import tempfile
from pathlib import Path

import click
from click.testing import CliRunner

from uvms_mj.cli import main as command

OUT = Path(__file__).parents[1] / "docs" / "push.gif"
CHOSEN = "--from 0.5 --to 10 --fps 20 --plots force,position"


@click.command()
@click.option("--out", default=OUT, type=click.Path(path_type=Path), show_default="docs/push.gif", help="GIF to write.")
def main(out: Path) -> None:
    """Run the built-in scenario and film it."""
    with tempfile.TemporaryDirectory() as folder:
        for words in (
            ["run", "--quiet", "--out", folder],
            ["video", f"{folder}/run.mcap", "--force", "--out", str(out), *CHOSEN.split()],
        ):
            done = CliRunner().invoke(command, words)
            if done.exit_code:
                raise click.ClickException(done.output)
    print(f"{out}: {out.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
