"""Long fuzzing campaign: thousands of mutated inputs, in processes with time and memory limits.

See tests/helpers/fuzzer.py.

python scripts/fuzz.py                        20,000 inputs
python scripts/fuzz.py --first 5000 --n 500   other seeds
python scripts/fuzz.py --seed 4711 --keep x   repeat one input and keep its files in the folder x
"""

import sys
import time
from pathlib import Path

import click

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))


@click.command()
@click.option("--first", type=int, default=0, show_default=True, help="The first seed.")
@click.option("--n", type=int, default=20_000, show_default=True, help="Number of seeds.")
@click.option("--workers", type=int, default=2, show_default=True, help="Number of parallel processes.")
@click.option("--seed", type=int, help="Run only this seed, in this process, and print its input.")
@click.option("--keep", type=click.Path(path_type=Path), default=Path("fuzzed"), help="Folder for the files of --seed.")
def fuzz(first: int, n: int, workers: int, seed: int | None, keep: Path) -> None:
    """Run uvms-mj on mutated inputs and print every failure. Exit status 1 if there is one."""
    from fuzzer import Failure, campaign, told, verdict
    from mutations import case

    if seed is not None:
        one = case(seed)
        keep.mkdir(parents=True)
        click.echo(f"{one.kind}: uvms-mj {' '.join(map(repr, one.arguments))}\nin {keep}: {', '.join(one.files)}")
        what = verdict(one, keep)
        click.echo(what or "passed")
        sys.exit(bool(what))
    start = time.monotonic()

    def progress(done: int, failure: Failure | None) -> None:
        if failure is not None:
            again = f"python scripts/fuzz.py --seed {failure.seed} --keep seed-{failure.seed}"
            click.echo(f"{told([failure])}\n{again}\n")
        if done % 100 == 0:
            click.echo(f"{done} of {n}, {time.monotonic() - start:.0f} s", err=True)

    failures, kinds = campaign(range(first, first + n), workers, progress)
    click.echo(f"{sum(kinds.values())} inputs in {time.monotonic() - start:.0f} s, {len(failures)} failed: {kinds}")
    sys.exit(bool(failures))


if __name__ == "__main__":
    fuzz()
