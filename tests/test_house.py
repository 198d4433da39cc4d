"""Limits on the layout of the source: entries at the top, the import contract, public names, extras."""

import ast
import dataclasses
import os
import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

import pytest
import yaml

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


def test_a_commit_is_checked_by_what_make_checks_runs():
    """pre-commit has the programs of the Makefile, and fetches none."""
    text = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    repos = yaml.safe_load(text)["repos"]
    assert [each["repo"] for each in repos] == ["local"]
    hooks = [hook for each in repos for hook in each["hooks"]]
    assert {hook["language"] for hook in hooks} == {"system"}
    (checks,) = re.findall(r"^checks: setup\n((?:\t.*\n)+)", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M)
    asked = [" ".join(line.replace("$(BIN)", ".venv/bin").split()).split(" src ")[0] for line in checks.splitlines()]
    assert [hook["entry"].replace(" --force-exclude", "") for hook in hooks] == asked


def test_workflows_try_every_python_and_every_system_that_is_promised():
    project = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    said = [each.rpartition(" ")[2] for each in project["classifiers"] if re.search(r":: 3\.\d+$", each)]
    assert project["requires-python"] == f">={said[0]}"
    for name, job in {"tests": "test", "wheel": "install"}.items():
        path = ROOT / ".github" / "workflows" / f"{name}.yml"
        matrix = yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"][job]["strategy"]["matrix"]
        assert matrix["python"] == said
        systems = {*matrix["os"], *(each["os"] for each in matrix.get("include", ()))}
        assert {"ubuntu-latest", "ubuntu-24.04-arm", "macos-latest"} == systems


def test_a_release_has_the_version_of_its_tag():
    """The wheel that the release looks for by its tag is the wheel that is built."""
    jobs = yaml.safe_load((ROOT / ".github" / "workflows" / "wheel.yml").read_text(encoding="utf-8"))["jobs"]
    release, version = jobs["release"], tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]["version"]
    assert release["needs"] == "install"
    assert release["permissions"] == {"contents": "write"}
    (wanted,) = (step["run"] for step in release["steps"] if "whl" in step.get("run", ""))
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "dist").mkdir()
        Path(folder, "dist", f"uvms_mj-{version}-py3-none-any.whl").touch()
        for tag, ends in ((f"v{version}", 0), ("v99.0", 1)):
            ended = subprocess.run(["bash", "-c", wanted], cwd=folder, env=os.environ | {"GITHUB_REF_NAME": tag})
            assert ended.returncode == ends
