"""``uvms-mj identify``: coefficients of a vehicle from measurements."""

import json
from typing import TYPE_CHECKING, Any

import click

from .common import Listing, Resumed, bad_input, draw_to_files, printable, warn
from .options import command, output_options, path_option

if TYPE_CHECKING:
    from pathlib import Path

    from ..studies.identify.result import Result


@command(epilog="Exit status: 0 done, 2 bad input or no space, 130 interrupted (143 SIGTERM, 129 SIGHUP).")
@click.argument("file", metavar="FILE.toml")
@path_option("-o", "--out", metavar="DIR", help="Folder of the results [default: runs/<name of the identification>].")
@click.option(
    *("-j", "--workers"),
    type=click.IntRange(1, 4096),
    default=1,
    metavar="N",
    help="Processes for the derivatives [default: 1, which is as fast for short logs].",
)
@output_options
def identify(file: str, out: str | None, workers: int, as_json: bool, quiet: bool) -> None:
    """Find coefficients of a vehicle from measurements, by least squares on the plant.

    FILE.toml names the vehicle with which it begins, the coefficients that are free, and the data: logs of motions,
    with or without inputs, tables of a towing, and attitudes at rest, as CSV, Parquet or MCAP.

    \b
    name = "my_rov"                      the new vehicle
    vehicle = "bluerov2_heavy"           the vehicle with which it begins
    [[free]]
    name = "X_uu"                        as in the vehicle's file, with its sign
    [[experiment]]
    data = "coast.csv"
    time = {column = "t", unit = "s"}
    held_out_from = 12.0
    [experiment.signals.nu]
    columns = ["speed", "", "", "", "", ""]

    \b
    uvms-mj new identify my_rov
    uvms-mj identify my_rov.toml --out found
    uvms-mj vehicles found/my_rov.xml

    DIR gets the vehicle NAME.xml, identified.toml with 95 % intervals, and report.html with the residuals. A
    coefficient that the data can't tell from others is named, and is not given. After any interruption the same command
    goes on where it was.
    """
    from pathlib import Path

    resumed = Resumed("iterations")
    draw_to_files()
    with bad_input():
        from ..studies.identify import Identification

        identification = Identification.load(file)
        folder = Path(out) if out is not None else Path("runs", identification.file.name)
    with resumed.filling(folder):
        with bad_input():
            identification.refuse_another(folder)
            with resumed.bar("fitting", as_json or quiet, "iteration {done:.0f}, rms {rms}", rms="-") as update:

                def progress(done: int, rms: float) -> None:
                    update(done, done + 1, rms=f"{rms:.4g}")

                result = identification.run(folder, workers=workers, progress=progress)
        if as_json:
            click.echo(json.dumps(_report(result, identification.file.name, folder), allow_nan=False))
        elif not quiet:
            _print(result, identification.file.name, folder)


def _report(result: "Result", name: str, folder: "Path") -> dict[str, Any]:
    return {
        "identification": name,
        **result.tables(),
        "vehicle": str(folder / f"{name}.xml"),
        "folder": str(folder),
    }


def _print(result: "Result", name: str, folder: "Path") -> None:
    """Print the coefficients, the unknowns that are not told apart, and the errors on held-out data."""
    rows: list[tuple[str, ...]] = [
        (
            f"{each.name} [{each.unit}]",
            f"{each.start:.6g}",
            f"{each.value:.6g}" if each.given else "-",
            f"{each.half_width:.2g}" if each.given else "-",
        )
        for each in result.coefficients
    ]
    heads = ("before", "found", "+- (95 %)")
    Listing(name, ("", *heads), rows, right=heads, width=70).show()
    for each in result.coefficients:
        if not each.given:
            click.echo(f"{each.name} is not given: {each.why_not}")
    if result.held_out:
        held: list[tuple[str, ...]] = [
            (
                f"{each.experiment}, {each.channel} [{each.unit}]",
                *(f"{value:.3g}" for value in (each.fitted, each.before, each.mean)),
            )
            for each in result.held_out
        ]
        heads = ("fitted", "vehicle before", "mean")
        Listing("rms errors on held-out data", ("", *heads), held, right=heads, width=70).show()
    for note in result.notes:
        warn(printable(note))
    click.echo(folder / "report.html")
    click.echo(f"uvms-mj vehicles {folder / f'{name}.xml'}")
