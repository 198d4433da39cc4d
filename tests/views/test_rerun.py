"""Recordings for Rerun: recorded values, bounded arrows, whole files."""

import dataclasses
import itertools
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from forked import done as forked
from traces import TASK, without
from uvms_mj import Scenario, Trace, simulate
from uvms_mj.physics.frames import quat_from_euler_deg
from uvms_mj.plant.geometry import solids
from uvms_mj.records import scene
from uvms_mj.stages.signals import BAND
from uvms_mj.views import colours
from uvms_mj.views import rerun as rerun_view
from uvms_mj.views.rerun import viewer
from uvms_mj.views.rerun.layout import layout
from uvms_mj.views.rerun.run import MOST_STEPS, POSE_HZ, Extents, Run, bounds, readable


def columns(path: Path) -> dict[str, dict[str, list]]:
    """Contents of a recording: for each entity its components, in the order of time, and the times [ns]."""
    found: dict[str, dict[str, list]] = {}
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        entity = found.setdefault(str(chunk.entity_path), {})
        for name in batch.schema.names:
            if name == "sim_time":
                entity.setdefault(name, []).extend(batch.column(name).cast("int64").to_pylist())
            elif not name.startswith("rerun."):
                entity.setdefault(name, []).extend(batch.column(name).to_pylist())
    for entity in found.values():
        assert entity.get("sim_time", []) == sorted(entity.get("sim_time", []))
    return found


@pytest.fixture(scope="module")
def recorded(recording) -> dict[str, dict[str, list]]:
    return columns(recording)


def test_scalars_are_those_of_the_log_to_the_last_bit(trace, recorded):
    found = recorded
    for signal in trace.signals:
        if signal.name == "t":
            continue
        values = trace[signal.name].reshape(len(trace), -1)
        whole = found.get(f"/signals/{signal.name}")
        parts = [whole] if whole else [found[f"/signals/{signal.name}/{part}"] for part in signal.components]
        read = np.concatenate([np.array(part["Scalars:scalars"]) for part in parts], axis=1)
        np.testing.assert_array_equal(read, values, err_msg=signal.name)
        for part in parts:
            np.testing.assert_array_equal(part["sim_time"], np.rint(trace.t * 1e9).astype(int))
    np.testing.assert_array_equal(np.array(found["/push"]["Scalars:scalars"])[:, 0], trace.push)
    assert trace.push.max() > 10.0
    assert {v for row in found["/push/analytic"]["Scalars:scalars"] for v in row} == {trace.analytic.force}


def test_poses_are_those_of_the_log_in_float32(trace, recorded):
    found = recorded
    every = round(1.0 / (POSE_HZ * (trace.t[1] - trace.t[0])))
    vehicle, reference = found["/world/vehicle"], found["/world/reference"]
    np.testing.assert_array_equal(
        np.array(vehicle["Transform3D:translation"])[:, 0], trace.p_WB[::every].astype("f4"), strict=False
    )
    np.testing.assert_array_equal(
        np.array(vehicle["Transform3D:quaternion"])[:, 0], trace.quat_WB[::every][:, [1, 2, 3, 0]].astype("f4")
    )
    np.testing.assert_array_equal(np.array(reference["Transform3D:translation"])[:, 0], trace.p_d[::every].astype("f4"))
    quat_d = quat_from_euler_deg(*trace.scenario.reference.attitude_deg)[[1, 2, 3, 0]].astype("f4")
    assert all(np.array_equal(row[0], quat_d) for row in reference["Transform3D:quaternion"])
    way = [row[0] for row in found["/world/trajectory"]["LineStrips3D:strips"] if row]
    assert all(end == start for (_, end), (start, _) in itertools.pairwise(way)), "a piece is missing"
    np.testing.assert_array_equal(way[-1][1], trace.p_WB[::every][-1].astype("f4"))


def test_arrows_are_the_forces(trace, recorded):
    found = recorded
    every = round(1.0 / (POSE_HZ * (trace.t[1] - trace.t[0])))
    contact = found["/world/contact\\ force"]
    both = zip(contact["Arrows3D:origins"], contact["Arrows3D:vectors"], strict=True)
    arrows = [(start[0], vector[0]) for start, vector in both if start]
    push = trace.f_contact_W[::every]
    assert len(arrows) == np.count_nonzero(push.any(axis=1)) > 10
    (start, vector), force = arrows[-1], push[-1]
    tip = trace.p_WB[::every][-1] + [trace.header.geometry.reach, 0.0, 0.0]
    np.testing.assert_allclose(np.add(start, vector), tip, atol=1e-6)
    np.testing.assert_allclose(np.array(vector) / np.linalg.norm(vector), force / np.linalg.norm(force), atol=1e-6)
    texts = [row[0] for row in found["/world/contact\\ force/text"]["Points3D:labels"] if row]
    assert texts[-1] == f"contact force {np.linalg.norm(force):.2f} N"


def strong(trace: Trace, times: float) -> Trace:
    """The same run with forces multiplied by ``times``."""
    names = ("tau", "f_contact_W", *BAND["tau"], *BAND["push"])
    return dataclasses.replace(trace, arrays={**trace.arrays, **{name: times * trace[name] for name in names}})


def test_no_arrow_leaves_the_scene(trace, tmp_path):
    rerun_view.save({"run": strong(trace, 100.0)}, tmp_path / "strong.rrd")
    found = columns(tmp_path / "strong.rrd")
    longest = 0.0
    for name in ("contact\\ force", "thrust"):
        vectors = [row[0] for row in found[f"/world/{name}"]["Arrows3D:vectors"] if row]
        longest = max(longest, np.linalg.norm(vectors, axis=1).max())
    assert 0.4 * scene.span(trace.header) < longest <= scene.span(trace.header)


def test_an_axis_holds_what_it_should_and_has_two_numbers_at_least(rng):
    """Rerun puts numbers only at multiples of a power of ten, and not at the end of an axis."""
    for exponent in rng.uniform(-6, 4, size=300):
        low, high = sorted(rng.normal(size=2) * 10.0**exponent + rng.choice([0.0, 50.0]))
        ends = readable([(low, high), (low, low)])
        assert ends[0] <= low <= high <= ends[1]
        length = ends[1] - ends[0]
        inside = [
            np.floor((ends[1] - 0.04 * length) / step) - np.ceil((ends[0] + 0.04 * length) / step) + 1
            for step in 10.0 ** np.arange(-9.0, 7.0)
        ]
        assert any(2 <= n <= MOST_STEPS + 1 for n in inside), (low, high, ends)
        assert high - low > 0.2 * length
    for point in (0.0, 2.0, -3e-4):
        low, high = readable([(point, point)])
        assert low < point < high


def test_a_run_without_the_impedance_task_is_replayed_without_its_signals(trace, other, tmp_path):
    less = without(trace, *TASK, "f_contact_m_W", "stretch_W")
    for traces in ({"a": less}, {"a": less, "b": other}):
        rerun_view.save(traces, tmp_path / "less.rrd")
        found = columns(tmp_path / "less.rrd")
        assert any(path.endswith("/tau/x") for path in found)
        assert any(path.endswith("/s/x") for path in found) == any("s" in each.arrays for each in traces.values())


def test_a_reference_that_turns_is_drawn_as_recorded(trace, tmp_path):
    quat_d = np.roll(trace.quat_WB, 7, axis=0)
    rows = trace.rows()
    rows[:, trace.header.places["quat_d"]] = quat_d
    turning = Trace.of(trace.header, rows, trace.outcome)
    rerun_view.save({"run": turning}, tmp_path / "turning.rrd")
    every = round(1.0 / (POSE_HZ * (trace.t[1] - trace.t[0])))
    shown = np.array(columns(tmp_path / "turning.rrd")["/world/reference"]["Transform3D:quaternion"])[:, 0]
    np.testing.assert_array_equal(shown, quat_d[::every][:, [1, 2, 3, 0]].astype("f4"))


def test_a_wall_that_turns_is_drawn_as_recorded(tmp_path):
    wall = {"shape": "box", "position": [1.5, 0.0, 0.0], "edges": [0.4, 1.0, 1.0]}
    wall |= {"turn_amplitude_deg": [0.0, 0.0, 20.0], "turn_frequency_hz": 1.0, "turn_phase_deg": 30.0}
    run = simulate(Scenario.load("push_wall", {"walls": [wall], "simulation.duration": 0.5}))
    rerun_view.save({"run": run}, tmp_path / "turning.rrd")
    every = round(1.0 / (POSE_HZ * (run.t[1] - run.t[0])))
    (shown,) = (each for path, each in columns(tmp_path / "turning.rrd").items() if path.endswith("moving\\ 0"))
    quat = np.array(shown["Transform3D:quaternion"])[:, 0]
    np.testing.assert_array_equal(quat, run.quat_WS0[::every][:, [1, 2, 3, 0]].astype("f4"))
    assert np.ptp(quat[:, 2]) > 0.1
    corners = np.array(shown["Mesh3D:vertex_positions"][0])
    np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], [[-0.2, -0.5, -0.5], [0.2, 0.5, 0.5]])


def test_markers_and_viewer_draw_one_scene(trace, recorded):
    """The wall, the current and the colours of the arrows come from records/scene.py."""
    found, drawn = recorded, scene.scene_of(trace.header)
    (wall,), (current,) = drawn.walls, drawn.arrows
    box = found["/world/wall"]
    np.testing.assert_allclose(box["Boxes3D:centers"][0], [wall.position], rtol=1e-6)
    np.testing.assert_allclose(box["Boxes3D:half_sizes"][0], [wall.size], rtol=1e-6)
    assert wall.position[0] - wall.size[0] == pytest.approx(scene.wall_face(trace.header), abs=1e-12)
    arrow = found["/world/current"]
    np.testing.assert_allclose(arrow["Arrows3D:vectors"][0], [current.tip - current.start], rtol=1e-6)
    for force in scene.FORCES:
        (colour,) = found[f"/world/{force.name}".replace(" ", "\\ ")]["Arrows3D:colors"][0]
        assert colour >> 8 == int.from_bytes(bytes(force.colour))


def test_the_force_plot_shows_where_each_run_comes_to_rest(trace):
    pushing = strong(trace, 8.0)
    for traces in ({"a": trace}, {"a": trace, "b": pushing}):
        runs = viewer._runs(traces)
        tabs = layout(runs).root_container.contents[1].contents[0]
        near, whole = tabs.contents
        assert tabs.active_tab == 0
        low, high = axis_of(near)
        for each in traces.values():
            assert low <= 0.0 < Extents.of(each).rest < 0.7 * high
            assert each.push.max() < axis_of(whole)[1]
        assert high < axis_of(whole)[1]
    live = layout([Run(trace.header)]).root_container.contents[1].contents[0]  # force at rest unknown
    assert "ScalarAxis" not in live.contents[live.active_tab].properties


def test_a_run_that_diverged_is_shown_with_others(trace, other, tmp_path):
    wild = {name: np.array(values) for name, values in trace.arrays.items()}
    growth = np.geomspace(1.0, 1e300, len(trace))
    for name in ("tau", "s", "f_contact_W"):
        wild[name] *= growth[:, None]
        wild[name][-3:] = np.nan
    traces = {"wild": dataclasses.replace(trace, arrays=wild), "tame": other}
    rerun_view.save(traces, tmp_path / "wild.rrd")
    assert viewer._runs(traces)[0].place.force_scale > 0.0


def test_a_vehicle_without_shapes_has_a_size():
    low, high = bounds([], 0.1)
    assert (low == -0.1).all()
    assert (high == 0.1).all()


def axis_of(view) -> tuple[float, float]:
    (limits,) = view.properties["ScalarAxis"].range.as_arrow_array().to_pylist()
    return tuple(limits)


def test_of_several_runs_none_hides_another(trace, other, tmp_path):
    """Each run has a lane wider than its vehicle, a name above it, and the colour of its law."""
    traces = {"a": trace, "b": other, "c": trace}
    rerun_view.save(traces, tmp_path / "three.rrd")
    found = columns(tmp_path / "three.rrd")
    corners = np.concatenate([solid.vertices for solid in solids(trace.header.geometry)])
    lanes = [found[f"/{label}/world"]["Transform3D:translation"][0][0] for label in traces]
    assert np.allclose(np.array(lanes)[:, [0, 2]], 0.0)
    y = np.array(lanes)[:, 1]
    assert (-np.diff(y)).min() > 1.5 * np.ptp(corners[:, 1])
    for label in traces:
        assert found[f"/{label}/world/vehicle/name"]["Points3D:labels"] == [[label]]
    runs = viewer._runs(traces)
    assert [run.colour for run in runs] == colours.of_runs(["gsta", "impedance", "gsta"])


def test_every_series_has_a_name_and_a_colour(trace, recorded):
    found = recorded
    scalars = {path: entity for path, entity in found.items() if "Scalars:scalars" in entity}
    names = []
    for path, entity in scalars.items():
        size = len(entity["Scalars:scalars"][0])
        (some,), (colours,) = entity["SeriesLines:names"], entity["SeriesLines:colors"]
        assert len(some) == len(colours) == size, path
        names += some
    assert len(set(names)) == len(names) == sum(s.size for s in trace.signals if s.name != "t") + 2
    assert "tau.x [N]" in names
    assert "s.yaw [rad/s]" in names


def test_blocks_and_thinning_change_nothing_but_the_number_of_samples(trace, tmp_path):
    def written(cuts: list[int], row_steps: int) -> dict[str, dict[str, list]]:
        stream = rr.RecordingStream("test", send_properties=False)
        stream.save(tmp_path / "blocks.rrd")
        run = Run(trace.header, row_steps=row_steps)
        run.begin(stream)
        for first, last in zip([0, *cuts], [*cuts, len(trace)], strict=True):
            run.write({s.name: trace[s.name][first:last].reshape(-1, s.size) for s in trace.signals})
        stream.flush()
        stream.disconnect()
        return columns(tmp_path / "blocks.rrd")

    whole, pieces = written([], 7), written([1, 2, 13, 997, 998, 4000], 7)
    assert whole.keys() == pieces.keys()
    for path in whole.keys() - {"/push/analytic"}:  # this entity has a sample at the ends of each block
        assert whole[path] == pieces[path], path
    np.testing.assert_array_equal(np.array(whole["/signals/nu"]["Scalars:scalars"]), trace.nu[::7])
    starts = np.concatenate([[0], np.arange(1, len(trace), 7)])[: len(trace.t[::7])]
    for name, extreme in (("tau_low", np.minimum), ("tau_high", np.maximum)):
        sent = np.array(whole[f"/signals/{name}/z"]["Scalars:scalars"])[:, 0]
        last = (len(sent) - 1) * 7 + 1
        np.testing.assert_array_equal(sent, extreme.reduceat(trace[name][:last, 2], starts))


def test_a_live_view_of_every_step_hides_no_step(tmp_path):
    """The law alternates at every step, and the viewer gets a tenth of the steps."""
    full = simulate(Scenario.load("push_wall", {"simulation.duration": 0.3}), log_rate="full")
    stream = rr.RecordingStream("test", send_properties=False)
    stream.save(tmp_path / "live.rrd")
    run = Run(full.header, row_steps=10)
    run.begin(stream)
    for first in range(0, len(full), 777):
        run.write({s.name: full[s.name][first : first + 777].reshape(-1, s.size) for s in full.signals})
    stream.flush()
    stream.disconnect()
    found = columns(tmp_path / "live.rrd")
    rows = simulate(Scenario.load("push_wall", {"simulation.duration": 0.3}), log_rate=1000)
    for name in ("tau", "s"):
        for edge, values in zip(BAND[name], rows.band(name), strict=True):
            sent = [found[f"/signals/{edge}/{axis}"]["Scalars:scalars"] for axis in "xyz"]
            np.testing.assert_array_equal(np.concatenate(sent, axis=1), values[:, :3], err_msg=edge)
    assert len(found["/signals/push_high"]["Scalars:scalars"]) == len(rows)


def test_runs_stand_side_by_side_in_one_recording(trace, other, tmp_path):
    labels = ("gsta k=3.5/a b", "impedance")
    rerun_view.save(dict(zip(labels, (trace, other), strict=True)), tmp_path / "two.rrd")
    reader = RrdReader(tmp_path / "two.rrd")
    assert len(reader.recordings()) == len(reader.blueprints()) == 1
    found = columns(tmp_path / "two.rrd")
    colours = set()
    for label, run in zip(labels, (trace, other), strict=True):
        root = "/" + rr.new_entity_path([label]).removeprefix("/")
        force = found[f"{root}/push"]
        np.testing.assert_array_equal(np.array(force["Scalars:scalars"])[:, 0], run.push)
        assert force["SeriesLines:names"] == [[f"{label}: push [N]"]]
        colours.add(force["SeriesLines:colors"][0][0])
        assert any(path.startswith(f"{root}/world/vehicle/") for path in found)
    assert len(colours) == 2


def test_a_tether_that_moves_is_drawn_along_its_nodes(tmp_path):
    keys = {"tether.elements": 4, "tether.length": 3.0, "tether.anchor": [-2.0, 0.0, 1.0], "simulation.duration": 0.5}
    trace = simulate(Scenario.load("push_wall", keys), engine="free_body")
    rerun_view.save({"run": trace}, tmp_path / "tether.rrd")
    strips = columns(tmp_path / "tether.rrd")["/world/tether"]["LineStrips3D:strips"]
    np.testing.assert_array_equal(np.array(strips[0][0]), trace.tether_nodes[0].astype("f4"))


def test_a_recording_is_written_whole_or_not_at_all(trace, tmp_path):
    code = """if True:
        import resource
        from pathlib import Path
        from uvms_mj import InputError, simulate, Scenario
        from uvms_mj.views import rerun as rerun_view
        trace = simulate(Scenario.load("push_wall", {"simulation.duration": 3.0}))
        resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, 1_000_000))
        try:
            rerun_view.save({"a": trace}, Path("run.rrd"))
        except InputError as error:
            print(error)
    """
    target = tmp_path / "run.rrd"
    target.write_text("earlier content")
    done = forked(code=code, cwd=tmp_path)
    assert done.stdout.startswith("run.rrd: can't write it: ")
    assert [path.name for path in tmp_path.iterdir()] == ["run.rrd"]
    assert target.read_text() == "earlier content"
