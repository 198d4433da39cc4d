"""Limits on the layout of the source: entries at the top, the import contract, public names, extras."""

import ast
import dataclasses
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import uvms_mj
from seeded_faults import seeded_faults
from uvms_mj import McapLog, Scenario, simulate
from uvms_mj.errors import EXTRAS, InputError, needs_extra
from uvms_mj.scenario import STAGES

ROOT = Path(__file__).parents[1]
HOUSE = ROOT / "src" / "uvms_mj"
PROJECT = ROOT / "pyproject.toml"
HEAVY = ("matplotlib", "mujoco", "numpy", "pandas", "pyarrow", "pydantic", "rerun", "rich", "scipy")


def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def test_the_top_of_the_package_has_at_most_22_entries():
    code = {path.parent for path in HOUSE.glob("*/*.py")} | set(HOUSE.glob("*.py"))
    assert len([path for path in code if not path.name.startswith("__")]) <= 22


def test_the_import_contract_is_short():
    _, contract, *_ = PROJECT.read_text(encoding="utf-8").split("[[tool.importlinter.contracts]]\n")
    assert 'type = "layers"' in contract
    assert "ignore_imports" not in contract
    assert len(contract.strip().splitlines()) <= 22


def test_type_checkers_see_every_public_name_where_it_is():
    (block,) = (node for node in tree(HOUSE / "__init__.py").body if isinstance(node, ast.If))
    seen = {
        (f"uvms_mj.{node.module}", alias.name, alias.asname)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert seen == {(f"uvms_mj.{module}", name, name) for name, module in uvms_mj._HOME.items()}
    assert all(getattr(uvms_mj, name) is not None for name in uvms_mj.__all__)


def test_the_base_class_of_every_table_of_a_stage_is_public():
    for choice in STAGES.values():
        assert getattr(uvms_mj, choice.base.__name__) is choice.base


def test_a_missing_extra_is_one_line_that_names_it():
    extras = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    assert set(extras) == {*EXTRAS, "dev", "docs"}
    for extra, packages in EXTRAS.items():
        assert extras[extra][0].startswith(packages.split(",")[0])
        with pytest.raises(InputError) as raised, needs_extra(extra):
            import a_package_that_is_not_installed  # noqa: F401  # the import fails
        assert str(raised.value).count("\n") == 0
        assert f"pip install 'uvms-mj[{extra}]'" in str(raised.value)
        assert "a_package_that_is_not_installed" in str(raised.value)


def test_every_seeded_fault_can_be_put_into_the_sources():
    faults = seeded_faults()
    assert len({fault.name for fault in faults}) == len(faults) >= 60
    for fault in faults:
        text = fault.place().read_text(encoding="utf-8")
        wrong = text.replace(fault.old, fault.new)
        assert ast.dump(ast.parse(wrong)) != ast.dump(ast.parse(text)), fault.name


def test_a_seeded_fault_of_a_file_that_moved_is_refused():
    fault = seeded_faults()[0]
    moved = dataclasses.replace(fault, file="src/uvms_mj/physics/elsewhere.py")
    with pytest.raises(ValueError, match=f"elsewhere.py has gone; its text is in {re.escape(fault.file)}"):
        moved.place()


def test_another_error_inside_an_extra_is_not_hidden():
    with pytest.raises(ZeroDivisionError), needs_extra("gym"):
        raise ZeroDivisionError


@pytest.mark.slow
@pytest.mark.parametrize(
    "needed",
    [
        {
            "--help": "",
            "run --help": "",
            "new law mine": "pydantic",
            "signals": "numpy pydantic rich",  # the rooms say what their stages are given
            "controllers": "numpy pydantic rich",
            "keys": "numpy pydantic rich",
            "vehicles": "mujoco numpy pydantic rich",
        },
        {"run -q --out run simulation.duration=1e-3": "mujoco numpy pydantic"},
    ],
    ids=len,
)
def test_a_command_imports_only_what_it_uses(tmp_path, needed):
    """Commands of one process, each of which needs at least what those before it need."""
    code = f"""if True:
        import sys
        from uvms_mj.cli import main
        for line in {[*needed]}:
            try:
                main(line.split())
            except SystemExit as ended:
                assert not ended.code
            print("imported", *[name for name in {HEAVY} if name in sys.modules], file=sys.stderr)
    """
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert re.findall(r"^imported ?(.*)$", done.stderr, re.MULTILINE) == [*needed.values()]


def test_reading_a_log_imports_no_theory_and_a_figure_no_pyplot(tmp_path):
    scenario = Scenario.load("push_wall", {"simulation.duration": 0.01})
    simulate(scenario, sinks=[McapLog(tmp_path / "run.mcap")])
    code = """if True:
        import sys
        from uvms_mj.records.trace import Trace
        assert Trace.load("run.mcap").analytic.force > 1.4
        theory = ("uvms_mj.control.theory", "uvms_mj.setup", "uvms_mj.analysis", "uvms_mj.engine", "scipy")
        print([name for name in sys.modules if name.startswith(theory)])
        import uvms_mj.views.figures
        print("matplotlib.pyplot" in sys.modules)
    """
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.stdout == "[]\nFalse\n", done.stderr
