"""Training of the learned policy: demonstrations to frames, frames to weights."""

from __future__ import annotations

import builtins
import json
from pathlib import Path

import numpy as np
import pytest

from mpvi_bt.apps.cli import main
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.hands.learned import training
from mpvi_bt.hands.learned.batches import Batches
from mpvi_bt.hands.learned.demonstration import Demonstration
from mpvi_bt.hands.learned.features import SCALE, WAYPOINTS
from mpvi_bt.hands.learned.mirroring import BODY, SIDE
from mpvi_bt.hands.learned.network import Networks, Weights
from mpvi_bt.hands.learned.training import Training, train
from mpvi_bt.hands.learned.training_set import read_frames
from tests.layouts import LAYOUT

STEPS, CLOSED = 120, 90


def demonstrate(path: Path, seed: int, grip: float = 1.0) -> None:
    """A hand comes down before the robot and closes, or opens; a pause of half a second is in it."""
    rng = np.random.default_rng(seed)
    moving = np.repeat(np.arange(STEPS), np.where(np.arange(STEPS) == 30, 16, 1))
    share = (moving / CLOSED)[:, None]
    arm = BODY.travel_arm[SIDE] + share * rng.normal(0, 0.3, 7)
    n = len(moving)
    action = np.zeros((n, 23))
    action[:, LAYOUT.torso], action[:, LAYOUT.arm[SIDE]] = BODY.travel_torso, arm
    action[:, LAYOUT.gripper[SIDE]] = np.where(moving >= CLOSED, -grip, grip)
    base = np.repeat(rng.normal(0, 0.3, (1, 3)), n, 0)
    around = np.array([0.6, 0.0, 0.7]) + rng.normal(0, 0.05, (n // 10 + 1, 128, 3))
    Demonstration(
        base, np.zeros((n, 3)), np.repeat(BODY.travel_torso[None], n, 0), arm, np.full(n, 0.1), action, around,
        np.arange(n, dtype=float) // 10,
    ).save(path)  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("demonstrations")
    (root / "pick").mkdir()
    for seed in range(4):
        demonstrate(root / "pick" / f"{seed}.npz", seed)
    return root


def trained(folder: Path, kept: Path, steps: int = 3, rows: int | None = None) -> dict[str, Array]:
    """Weights after a few steps; interrupted after so many rows."""
    told = []

    def tell(row: dict[str, object]) -> None:
        told.append(row)
        if len(told) == rows:
            raise KeyboardInterrupt

    return dict(train(Training(read_frames(folder, "pick"), 5, steps, steps), kept, tell).weights)


def test_pauses_are_left_out_of_demonstrations(folder: Path):
    """A scripted demonstrator plans while it stands; a policy that copied that would stand for ever."""
    frames = read_frames(folder, "pick")
    assert len(frames.look) == 4 * (STEPS + 2)


def test_a_stance_is_where_the_hand_closes(folder: Path):
    """Whatever the moment, what is foreseen is the posture at the end of the next closing."""
    frames = read_frames(folder, "pick")
    assert np.allclose(frames.stance[:, 7:], frames.moments.told_arm[frames.event], atol=0.02)
    assert (frames.moments.told_grip[frames.event + 1] < -0.9).all()
    assert (frames.moments.told_grip[frames.event - 1] > 0.9).all()


def test_undisturbed_samples_are_what_was_demonstrated(folder: Path):
    """The arm's waypoints are the commands that came next, relative to the one in force."""
    frames = read_frames(folder, "pick")
    batch = Batches(frames, np.arange(4)).actor(50, np.random.default_rng(0), disturbed=False)
    wanted = batch.wanted.reshape(50, WAYPOINTS, -1)
    assert np.abs(wanted[..., :7]).max() < 1e-6
    assert 0 < np.abs(wanted[..., 7:14]).max() < 0.4
    assert ((batch.progress >= 0) & (batch.progress <= 1)).all()


def test_the_same_seed_makes_the_same_weights(folder: Path, tmp_path: Path):
    """On one machine, bit by bit."""
    one, other = (trained(folder, tmp_path / name) for name in ("a.pt", "b.pt"))
    assert all(np.array_equal(one[name], other[name]) for name in one)


def test_an_interrupted_training_goes_on_to_the_same_weights(folder: Path, tmp_path: Path, monkeypatch):
    """Ctrl-C costs at most the steps since the last report."""
    monkeypatch.setattr(training, "_TOLD_STEPS", 2)
    whole = trained(folder, tmp_path / "a.pt", steps=5)
    with pytest.raises(KeyboardInterrupt):
        trained(folder, tmp_path / "b.pt", steps=5, rows=5)
    resumed = trained(folder, tmp_path / "b.pt", steps=5)
    assert all(np.array_equal(whole[name], resumed[name]) for name in whole)


def test_another_training_is_not_gone_on_with(folder: Path, tmp_path: Path):
    """A file of how far it is belongs to one seed, one set of demonstrations and one number of steps."""
    trained(folder, tmp_path / "a.pt", steps=3)
    with pytest.raises(UserError, match="of another training"):
        trained(folder, tmp_path / "a.pt", steps=4)


class Touching:
    """Touches a file when it is unpickled."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def __reduce__(self) -> tuple[object, ...]:
        return Path.touch, (self.file,)


def test_no_code_of_a_kept_training_is_run(folder: Path, tmp_path: Path):
    """A file with anything but numbers and weights is refused in one line."""
    import torch

    torch.save({"sizes": Touching(tmp_path / "touched")}, tmp_path / "a.pt")
    with pytest.raises(UserError, match="is no kept training") as caught:
        trained(folder, tmp_path / "a.pt")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "touched").exists()


def test_a_device_that_torch_lacks_is_refused(folder: Path, tmp_path: Path):
    """In a line, before anything is written."""
    with pytest.raises(UserError, match="device 'abacus'"):
        train(Training(read_frames(folder, "pick"), 5, 3, 3, "abacus"), tmp_path / "a.pt", lambda _: None)
    assert not (tmp_path / "a.pt").exists()


def test_numpy_runs_the_networks_as_torch_trained_them(folder: Path):
    """What the policy computes without torch is what was optimized."""
    import torch

    frames = read_frames(folder, "pick")
    batches, job = Batches(frames, np.arange(4)), Training(frames, 1, 1, 1)
    actor, proposer = training._Actor(batches, batches, job), training._Proposer(batches, batches, job)
    proposer.net.eval()
    networks = Networks({**training._named("actor", actor), **training._named("proposer", proposer)})
    rng = np.random.default_rng(0)
    points, told = rng.normal(size=(1, 64, 9)), actor.mean + actor.std * rng.normal(size=(1, 76))
    with torch.no_grad():
        out = actor.answer(points, np.clip((told - actor.mean) / actor.std, -6, 6))[0].numpy()
    waypoints, progress = networks.act(points, told, 32)
    assert np.allclose(waypoints, out[:-1].reshape(WAYPOINTS, -1) * SCALE, atol=1e-4)
    assert progress == pytest.approx(1 / (1 + np.exp(-out[-1])), abs=1e-4)
    points, told = rng.normal(size=(1, 96, 4)), rng.normal(size=(1, 4))
    with torch.no_grad():
        answer = proposer.answer(points, told).view(16, 24).numpy()
    hypotheses, likely = networks.propose(points, told, 48)
    assert np.allclose(hypotheses, answer[:, :-1] * proposer.std + proposer.mean, atol=1e-4)
    assert np.allclose(np.exp(likely).sum(), 1)


def test_a_broken_demonstration_is_left_out_and_told(folder: Path, tmp_path: Path):
    """One file that was cut off does not cost the other thousand."""
    (tmp_path / "pick").mkdir()
    whole = (folder / "pick" / "0.npz").read_bytes()
    (tmp_path / "pick" / "0.npz").write_bytes(whole)
    (tmp_path / "pick" / "1.npz").write_bytes(whole[: len(whole) // 2])
    told: list[str] = []
    frames = read_frames(tmp_path, "pick", told.append)
    assert len(told) == 1
    assert "1.npz: left out" in told[0]
    assert set(frames.episode) == {0}


def test_a_folder_without_demonstrations_is_refused(tmp_path: Path):
    """The message says where to read how they are made."""
    with pytest.raises(UserError, match=r"no demonstrations; docs/learned_training\.md"):
        read_frames(tmp_path, "pick")


def test_a_skill_that_cannot_be_learned_is_refused_with_the_nearest(tmp_path: Path):
    """A typing error is told before anything is read."""
    with pytest.raises(UserError, match=r"unknown learned skill 'pik'\. .*pick"):
        read_frames(tmp_path, "pik")


def test_of_a_place_a_stance_is_where_the_hand_opens(tmp_path: Path):
    """What is foreseen is the posture at which the payload is let go of."""
    (tmp_path / "place_in").mkdir()
    demonstrate(tmp_path / "place_in" / "0.npz", 0, grip=-1.0)
    frames = read_frames(tmp_path, "place_in")
    assert (frames.moments.told_grip[frames.event] < -0.9).all()
    assert (frames.moments.told_grip[frames.event + 1] > 0.9).all()


def test_without_torch_training_says_how_to_install_it(folder: Path, tmp_path: Path, monkeypatch):
    """It is an extra; running a policy needs none."""
    whole = builtins.__import__

    def without(name, *args, **kwargs):
        if name == "torch":
            raise ImportError
        return whole(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(UserError, match=r"training needs torch: pip install .*train"):
        trained(folder, tmp_path / "a.pt")


@pytest.mark.parametrize("out", ["mine", "mine.pt", "no_folder/mine.npz"])
def test_a_file_that_cannot_be_written_is_refused_before_training(folder: Path, tmp_path: Path, out: str, capsys):
    """Not after half an hour."""
    with pytest.raises(SystemExit) as ended:
        main(["train", "learned", str(folder), "--out", str(tmp_path / out)])
    assert ended.value.code == 2
    assert "name a file FILE.npz in a folder that there is" in capsys.readouterr().err


def test_the_command_leaves_weights_that_the_policy_loads_and_the_curves(folder: Path, tmp_path: Path, capsys):
    """A first try of a few steps ends with files that say how they were made."""
    out = tmp_path / "mine.npz"
    with pytest.raises(SystemExit) as ended:
        main(["train", "learned", str(folder), "--out", str(out), "--actor-steps", "2", "--proposer-steps", "2"])
    assert not ended.value.code
    assert Weights.load(out).about["pick"]["demonstrations"] == 4
    assert [row["network"] for row in json.loads((tmp_path / "mine.pick.json").read_text())] == ["proposer", "actor"]
    assert "mine.npz: pick" in capsys.readouterr().out


def test_skills_are_added_to_a_file_of_weights(folder: Path, tmp_path: Path, capsys):
    """What it held of another skill is there afterwards, to the bit, with what was told of it."""
    out, steps = tmp_path / "mine.npz", ["--actor-steps", "2", "--proposer-steps", "2"]
    (tmp_path / "place_in").mkdir()
    demonstrate(tmp_path / "place_in" / "0.npz", 0, grip=-1.0)
    demonstrate(tmp_path / "place_in" / "1.npz", 1, grip=-1.0)
    whole = []
    for data, skill in ((folder, "pick"), (tmp_path, "place_in")):
        with pytest.raises(SystemExit) as ended:
            main(["train", "learned", str(data), "--skills", skill, "--out", str(out), *steps])
        assert not ended.value.code
        whole.append(Weights.load(out))
    first, second = whole
    assert list(second.skills) == list(second.about) == ["pick", "place_in"]
    assert second.about["pick"] == first.about["pick"]
    was, now = first.skills["pick"].weights, second.skills["pick"].weights
    assert all(np.array_equal(was[name], now[name]) for name in was)
