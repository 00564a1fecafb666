"""Control tasks: spaces, episodes, vectors, physics, recordings."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import gymnasium
import iplw
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from iplw.families import CONTROL_TASKS
from iplw.joint_recording import JointRecording


@pytest.mark.parametrize("name", CONTROL_TASKS)
def test_environments_pass_gymnasiums_checks(name: str) -> None:
    with gymnasium.make(name, render_mode="rgb_array") as env:
        check_env(env.unwrapped)
        env.reset(seed=1)
        picture = env.render()
        assert isinstance(picture, np.ndarray) and picture.shape == (256, 256, 3) and len(np.unique(picture)) > 3


def test_rewards_and_ends_are_those_of_the_task() -> None:
    with gymnasium.make("iplw/CartPoleBalance-v0", reward="sparse").unwrapped as env:
        env.reset(seed=1)
        rewards, terminated = [], False
        while not terminated:
            _, reward, terminated, truncated, info = env.step(np.array([10.0]))
            rewards.append(reward)
        assert rewards[-1] == 0.0 and set(rewards[:-1]) == {1.0} and not truncated
        with pytest.raises(iplw.Problem, match="reset"):
            env.step(np.array([0.0]))


def test_a_vector_steps_as_its_environments_do() -> None:
    vector = gymnasium.make_vec("iplw/CartPoleBalance-v0", num_envs=5, vectorization_mode="vector_entry_point")
    single = gymnasium.make("iplw/CartPoleBalance-v0").unwrapped
    try:
        first, _ = vector.reset(seed=3)
        again, _ = single.reset(seed=3)
        assert np.array_equal(first[0], again)
        assert len({row.tobytes() for row in first}) == 5
        ended = np.zeros(5, np.bool_)
        for _ in range(60):
            observations, rewards, terminated, truncated, infos = vector.step(np.full((5, 1), 10.0))
            assert (rewards[ended] == 0.0).all() and (np.abs(observations[ended][:, 2]) < 0.06).all()
            ended = terminated | truncated
        assert infos["position"].shape == (5, 2)
    finally:
        vector.close()
        single.close()


def test_environments_that_are_reset_do_not_disturb_others() -> None:
    """The next steps of some reset them while others move, each with actions of its own."""
    vectors = [gymnasium.make_vec("iplw/CartPoleBalance-v0", num_envs=n, vectorization_mode="vector_entry_point") for n in (6, 2)]
    random = np.random.default_rng(5)
    try:
        for vector in vectors:
            vector.reset(seed=2)
        for _ in range(150):
            actions = random.uniform(-10, 10, (6, 1))
            wide, narrow = vectors[0].step(actions), vectors[1].step(actions[:2])
            for many, few in zip(wide[:4], narrow[:4]):
                assert np.array_equal(many[:2], few)
    finally:
        for vector in vectors:
            vector.close()


def test_same_step_resets_keep_the_last_observation() -> None:
    vector = gymnasium.make_vec(
        "iplw/CartPoleBalance-v0", num_envs=2, vectorization_mode="vector_entry_point", autoreset_mode="SameStep"
    )
    try:
        vector.reset(seed=1)
        for _ in range(60):
            observations, _, terminated, _, infos = vector.step(np.full((2, 1), 10.0))
            if terminated.any():
                i = int(np.argmax(terminated))
                assert abs(infos["final_obs"][i][2]) > 0.21 and abs(observations[i][2]) < 0.06
                return
        raise AssertionError("no episode ended")
    finally:
        vector.close()


def test_ranges_of_physics_are_drawn_at_each_reset() -> None:
    friction = {"joint": "slide", "name": "viscous_friction", "parameters": {"b": [0.0, 50.0]}}
    with iplw.Client() as client, client.create_control_world(
        "cart_pole_balance", count=8, physics={"effects": [friction]}
    ) as world:
        world.reset(seed=1)
        velocities = np.asarray(world.step(np.full((8, 1), 10.0))["velocity"])[:, 0]
        assert velocities.std() > 0.01
        world.set_physics()
        world.reset(seed=1)
        assert np.asarray(world.step(np.full((8, 1), 10.0))["velocity"])[:, 0].std() < 0.05
        with pytest.raises(iplw.Problem, match=r"physics|effects\[0\].name|stiction"):
            world.set_physics([{"joint": "slide", "name": "stiction"}])
        for noise, field in (({"elbow": 0.1}, "physics.noise.elbow"), ({"slide": -1.0}, "physics.noise.slide")):
            with pytest.raises(iplw.Problem, match=field):
                world.set_physics(noise=noise)


def test_real_worlds_hide_their_physics() -> None:
    with iplw.Client() as client, client.create_control_world("pendulum_swing_up", kind="real") as world:
        world.reset(seed=1)
        assert "real" not in str(world.data["task"]) and "payload" not in str(world.data)
        with pytest.raises(iplw.Problem, match="real"):
            world.set_physics()
        with pytest.raises(iplw.Problem, match="real"):
            world.rollout([[[0.1]]])
        world.step([[0.1]])
        assert world.motion_seconds == pytest.approx(0.02)


def test_rollouts_are_what_steps_do() -> None:
    with iplw.Client() as client, client.create_control_world("acrobot") as world:
        world.reset(seed=4)
        actions = np.random.default_rng(1).uniform(-3, 3, (3, 20, 1))
        rolled = world.rollout(actions)
        steps = [float(world.step(action[None])["reward"][0]) for action in actions[1]]
        assert np.allclose(np.asarray(rolled["reward"])[1], steps, atol=1e-9)


def test_recordings_have_positions_and_commands() -> None:
    with iplw.ControlEnv("reacher", "real") as env:
        env.reset(seed=2)
        env.step(np.array([2.0, 0.1]))
        env.step(np.array([-0.5, 0.2]))
        rows = list(csv.DictReader(io.StringIO(env.trials())))
    assert [row["t"] for row in rows] == ["0", "0.02", "0.04"]
    assert [float(row["shoulder.command"]) for row in rows] == [1.0, -0.5, -0.5]
    assert float(rows[0]["elbow"]) != float(rows[2]["elbow"])


def test_recordings_leave_out_episodes_without_steps() -> None:
    task = {"joints": ["hinge"], "actions": [{"name": "hinge", "low": -1.0, "high": 1.0}], "interval": 0.5}
    recording = JointRecording(task)
    recording.begin(np.array([0.0]))
    recording.begin(np.array([0.1]))
    recording.add(np.array([3.0]), np.array([0.2]))
    assert recording.csv().splitlines()[1:] == ["1,0,0.1,1", "1,0.5,0.2,1"]


def test_tasks_of_users_are_documents(tmp_path: Path) -> None:
    with iplw.Client() as client:
        scene = client.control_tasks()[0]["scene"]
        task = {
            "format": "iplw.control/1",
            "name": "spin",
            "scene": scene,
            "interval": 0.02,
            "time_limit": 1.0,
            "actions": {"hinge": [-0.5, 0.5]},
            "observations": [{"name": "speed", "value": "hinge_velocity"}],
            "reward": {"dense": "hinge_velocity", "sparse": "hinge_velocity > 5"},
        }
        with client.create_control_world(definition=task) as world:
            world.reset(seed=1)
            assert np.asarray(world.step([[0.5]])["observation"]).shape == (1, 1)
        with pytest.raises(iplw.Problem, match="definition.reward.dense"):
            client.create_control_world(definition={**task, "reward": {"dense": "speed", "sparse": "0"}})


def test_recordings_lead_to_the_missing_effect() -> None:
    friction = {"joint": "hinge", "name": "viscous_friction", "parameters": {"b": 0.03}}
    random = np.random.default_rng(3)
    with iplw.ControlEnv("pendulum_swing_up", effects=[friction], noise={"hinge": 0.001}) as env:
        for episode in range(5):
            env.reset(seed=episode)
            for _ in range(8):
                command = random.uniform(-0.5, 0.5, 1)
                for _ in range(15):
                    env.step(command)
        scene = env.world.data["task"]["scene"]
        found = env.client.diagnose(scene, env.trials()).wait()
    assert isinstance(found, iplw.Diagnosis)
    assert found.verdict == "named" and [e["name"] for e in found["effects"]] == ["viscous_friction"], found["reason"]
    (parameter,) = found["effects"][0]["parameters"]
    assert parameter["ci95"][0] < 0.03 < parameter["ci95"][1]
    assert found.extended_scene is not None and "viscous_friction" in str(found.extended_scene)
    assert found.sets()[0][0] == "viscous_friction (hinge)" and "viscous_friction" in found._repr_html_()
