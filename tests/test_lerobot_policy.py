"""A small ACT made by LeRobot's own factory, and run by us."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mpvi_bt.executive.remote.dialect_settings import DialectSettings
from mpvi_bt.executive.remote.lerobot_frames import frame_of
from mpvi_bt.executive.remote.lerobot_policy import LerobotPolicy
from mpvi_bt.executive.remote.openpi import OpenpiPolicy
from mpvi_bt.ground.errors import PolicyError
from mpvi_bt.runs.choices.policies import for_clients
from mpvi_bt.testing import check_policy
from mpvi_bt.testing.doubles import KinematicRobot
from tests.layouts import ACTION_SIZE
from tests.lerobot_files import OURS, dataset, tell_dataset
from tests.serving import serving

torch: Any = pytest.importorskip("torch")
pytest.importorskip("lerobot", reason="needs the extra lerobot, in an environment of its own (docs/lerobot.md)")


def small_act(folder: Path, **changed: Any) -> Path:
    """An ACT of 8 rows that was never trained, with the features of `mpvi dataset`, of an r1 at 10 Hz."""
    from lerobot.configs.types import FeatureType, PolicyFeature
    from lerobot.policies.act.configuration_act import ACTConfig
    from lerobot.policies.act.modeling_act import ACTPolicy
    from lerobot.policies.factory import make_pre_post_processors

    inputs = {key: PolicyFeature(FeatureType[one["type"]], tuple(one["shape"])) for key, one in OURS.items()}
    small = {"dim_model": 32, "n_heads": 2, "dim_feedforward": 64, "n_encoder_layers": 1, "device": "cpu"}
    config = ACTConfig(
        input_features=inputs,
        output_features={"action": PolicyFeature(FeatureType.ACTION, (ACTION_SIZE,))},
        pretrained_backbone_weights=None,
        push_to_hub=False,
        **{"chunk_size": 8, "n_action_steps": 8, **small, **changed},
    )
    torch.manual_seed(0)
    ACTPolicy(config).save_pretrained(folder)
    sizes = {key: (3, 1, 1) if one["type"] == "VISUAL" else one["shape"] for key, one in OURS.items()}
    sizes["action"] = (ACTION_SIZE,)
    spread = {key: {"mean": torch.full(tuple(size), 0.5), "std": torch.full(tuple(size), 0.25)}
              for key, size in sizes.items()}  # fmt: skip
    for one in make_pre_post_processors(config, dataset_stats=spread):
        one.save_pretrained(folder)
    tell_dataset(folder, dataset(folder.parent / "picks"))
    return folder


@pytest.fixture(scope="module")
def act(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_act(tmp_path_factory.mktemp("lerobot") / "act")


def seen(moved_rad: float = 0.0) -> dict[str, Any]:
    robot = KinematicRobot()
    body = robot.proprioception()
    body = replace(body, arm={side: angles + moved_rad for side, angles in body.arm.items()})
    images = {camera: robot.look(camera) for camera in ("head", "right")}
    return {"prompt": "pick up the cup", "proprioception": body, "images": images}


def theirs(folder: Path, observations: list[dict[str, Any]]) -> Any:
    """What LeRobot itself does, as its `predict_action` has it: a row for each observation."""
    from lerobot.configs.policies import PreTrainedConfig
    from lerobot.policies.factory import get_policy_class, make_pre_post_processors
    from lerobot.policies.utils import prepare_observation_for_inference

    config = PreTrainedConfig.from_pretrained(folder)
    policy = get_policy_class(config.type).from_pretrained(folder)
    before, after = make_pre_post_processors(config, pretrained_path=str(folder))
    policy.reset()
    one = LerobotPolicy(folder, DialectSettings()).checkpoint
    rows = []
    for observation in observations:
        batch = prepare_observation_for_inference(
            frame_of(observation, one, DialectSettings()), torch.device("cpu"), observation["prompt"], "r1"
        )
        with torch.inference_mode():
            rows.append(after(policy.select_action(before(batch)))[0].numpy())
    return np.array(rows)


def test_a_checkpoint_is_a_policy(act: Path) -> None:
    """It keeps the contract, with pictures of the size and at the rate that it was trained with."""
    policy = LerobotPolicy(act, DialectSettings(), "r1")
    check_policy(policy, make=lambda: LerobotPolicy(act, DialectSettings(), "r1"))
    assert (policy.rate_hz, policy.cameras) == (10.0, ("head", "right"))
    assert policy.infer(seen()).shape == (8, ACTION_SIZE)


def test_its_chunk_is_what_lerobot_itself_does(act: Path) -> None:
    """Row by row, with LeRobot's own processors: our chunk is what its loop carries out from one observation."""
    ours = LerobotPolicy(act, DialectSettings(), "r1").infer(seen())
    np.testing.assert_allclose(ours, theirs(act, [seen()] * 8), atol=1e-5)
    assert np.abs(ours - LerobotPolicy(act, DialectSettings(), "r1").infer(seen(0.5))).max() > 1e-3


def test_who_averages_its_chunks_does_as_in_lerobot(tmp_path: Path) -> None:
    """A checkpoint that is asked for each row gives the rows of LeRobot's loop, and begins anew at a reset."""
    folder = small_act(tmp_path / "act", n_action_steps=1, temporal_ensemble_coeff=0.01)
    told = [seen(0.1 * k) for k in range(4)]
    policy = LerobotPolicy(folder, DialectSettings(), "r1")
    for _ in range(2):
        policy.reset()
        rows = [policy.infer(observation) for observation in told]
        assert {len(row) for row in rows} == {1}
        np.testing.assert_allclose(np.concatenate(rows), theirs(folder, told), atol=1e-5)


def test_served_by_us_it_does_the_same(act: Path) -> None:
    """`mpvi serve lerobot:FOLDER` answers openpi's protocol with the same actions and says the rate."""
    here = LerobotPolicy(act, DialectSettings(), "r1")
    with serving(for_clients(f"lerobot:{act}", 0)) as server:
        there = OpenpiPolicy(f"127.0.0.1:{server.port}")
        there.reset()
        assert there.cameras == ("head", "right")
        for moved_rad in (0.0, 0.3):
            np.testing.assert_allclose(there.infer(seen(moved_rad)), here.infer(seen(moved_rad)), atol=1e-5)
        assert there.rate_hz == 10.0
        there.close()


def test_a_checkpoint_that_lerobot_cannot_load_is_told_of_in_a_line(tmp_path: Path) -> None:
    """Such as one of a newer LeRobot, whose settings this one does not know."""
    folder = small_act(tmp_path / "act")
    config = folder / "config.json"
    config.write_text(config.read_text().replace('"chunk_size"', '"chunks_of_tomorrow": 1, "chunk_size"'))
    with pytest.raises(PolicyError, match="chunks_of_tomorrow") as told:
        LerobotPolicy(folder, DialectSettings(), "r1").infer(seen())
    assert told.value.reason == "server_error"
    assert str(told.value).isprintable()
