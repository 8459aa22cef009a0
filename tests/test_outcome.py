"""A solve that failed: what it says, what it writes, what it refuses."""

import json
from pathlib import Path

import numpy as np
import pytest

import planner
from planner.outcome import REMEDIES, Failure, NotSolvedError, failure

TRANSPORT = Path(__file__).resolve().parents[1] / "urdf" / "human_arms" / "transport.toml"


@pytest.mark.parametrize("status", REMEDIES)
def test_every_status_has_a_remedy(status):
    failed = failure(status, "it stopped", None, nodes=3)
    assert failed.remedy == REMEDIES[status]
    assert failed.evidence == {"nodes": 3}
    assert not failed.solved
    with pytest.raises(NotSolvedError, match=f"{status}: it stopped; "):
        failed.unwrap()


def test_unknown_status_is_a_bug():
    with pytest.raises(AssertionError):
        Failure("tired", "it stopped", "rest")


def test_save_leaves_no_trajectory(tmp_path):
    scenario = planner.load(TRANSPORT)
    folder = tmp_path / "deep" / "out"
    folder.mkdir(parents=True)
    (folder / "trajectory.npz").write_bytes(b"an earlier plan's")
    (folder / "notes.txt").write_text("the user's")
    written = failure("mesh-full", "full", scenario, rms_residual=0.1).save(folder)
    assert written == folder / "plan.json"
    assert sorted(path.name for path in folder.iterdir()) == ["notes.txt", "plan.json"]
    content = json.loads(written.read_text())
    assert content["status"] == "mesh-full"
    assert content["evidence"] == {"rms_residual": 0.1}
    assert content["scenario"] == scenario.resolved()
    with pytest.raises(planner.InputError, match="ended with mesh-full"):
        planner.Plan.load(folder)


@pytest.mark.parametrize("value", [np.float64(0.5), np.int64(3), float("nan"), float("inf")])
def test_saved_evidence_is_plain_json(tmp_path, value):
    def refuse(name):
        raise AssertionError(f"{name} is no JSON")

    written = failure("no-descent", "stuck", None, value=value).save(tmp_path)
    json.loads(written.read_text(), parse_constant=refuse)


def test_a_solve_that_fails_is_returned():
    settings = {"solver.max_nodes": 25, "solver.tolerance": 1e-9, "solver.start": "line"}
    failed = planner.plan(planner.load(TRANSPORT, settings))
    assert isinstance(failed, Failure)
    assert failed.status == "mesh-full"
    assert "25" in failed.reason
    assert failed.scenario.solver.max_nodes == 25
