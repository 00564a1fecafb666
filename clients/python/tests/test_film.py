"""Films of steps: no extra interaction, standard video files."""

from __future__ import annotations

import asyncio
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeAlias

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.save_video import save_video
from gymnasium.wrappers import Autoreset, TimeLimit
from numpy.typing import NDArray
from PIL import Image

import iplw
from iplw import png
from iplw.envs import PlacementEnv
from iplw.families import FAMILIES

TASK = "bowling:000"
Action: TypeAlias = NDArray[np.float64]


@pytest.fixture(scope="module")
def solution(client: iplw.Client) -> Action:
    """An action that solves the task."""
    return np.asarray(client.task(TASK)["certificate"]["action"])


@pytest.fixture
def played(solution: Action) -> Iterator[PlacementEnv]:
    """An environment after an episode in a real world with noise."""
    env = PlacementEnv(world={"kind": "real", "noise": 0.01, "budget": 1}, render_mode="rgb_array")
    env.reset(seed=1, options={"task": TASK})
    env.step(solution)
    yield env
    env.close()


def test_film_costs_no_interaction(played: PlacementEnv, solution: Action) -> None:
    film = played.film()
    assert film.frames.dtype == np.uint8 and film.frames.shape[1:] == (256, 256, 3)
    assert len({frame.tobytes() for frame in film}) >= 50
    assert film.fps == iplw.envs.FPS and len(film) == len(film.frames)
    assert np.array_equal(film[-1], png.decode(played.world.render(view="end", width=256)))
    assert f"{len(film)} frames" in repr(film) and "data:image/apng;base64," in film._repr_html_()
    # The film is reproducible, including noise; twice the frame rate keeps the duration.
    again, finer = played.film(), played.film(fps=60, width=128)
    assert again.png == film.png
    assert abs(finer.duration - film.duration) < 1 / 30 and finer.frames.shape[1] == 128
    assert played.world.interactions == 1
    with pytest.raises(iplw.Problem) as caught:
        played.world.rollout([solution])
    assert caught.value.slug == "budget-spent", "no interaction was left for the film"


@pytest.mark.parametrize("name", list(FAMILIES)[:2])
def test_film_keeps_latents_of_the_step(name: str) -> None:
    env = gymnasium.make(name, render_mode="rgb_array").unwrapped
    assert isinstance(env, PlacementEnv)
    with pytest.raises(iplw.Problem, match="no step has been made") as caught:
        env.film()
    assert caught.value.status == 409
    env.reset(seed=1)
    while not env.step(env.action_space.sample())[-1]["valid"]:
        pass
    film = env.film()
    env.set_latents(restitution=0.95)
    env.reset(seed=2)
    assert env.film().png == film.png
    env.close()


def test_render_shows_start_then_end(played: PlacementEnv) -> None:
    end = played.render()
    assert isinstance(end, np.ndarray) and np.array_equal(end, played.film()[-1])
    played.reset(options={"task": TASK})
    start = played.render()
    assert isinstance(start, np.ndarray)
    assert not np.array_equal(start, end)
    assert np.array_equal(start, png.decode(played.world.render(width=256)))


def test_render_mode_list_has_the_motion(solution: Action, tmp_path: Path) -> None:
    env = gymnasium.make("iplw/Bowling-v0", render_mode="rgb_array_list")
    assert isinstance(env.unwrapped, PlacementEnv) and env.metadata["render_fps"] == iplw.envs.FPS
    env.reset(options={"task": TASK})
    assert len(new_frames(env)) == 1 and new_frames(env) == []
    for _ in range(2):
        env.reset(options={"task": TASK})
        env.step(solution)
    frames = new_frames(env)
    assert np.array_equal(frames, env.unwrapped.film().frames) and new_frames(env) == []
    if _has("imageio_ffmpeg"):
        save_video(frames, str(tmp_path), fps=env.metadata["render_fps"], episode_trigger=lambda _: True)
        # (moviepy may lose the last frame to rounding.)
        assert 0 <= len(frames) - frames_of(tmp_path / "rl-video-episode-0.mp4") <= 1
    # As Gymnasium's RecordVideo calls it, which keeps one frame of each call.
    env.reset(options={"task": TASK})
    new_frames(env)
    env.step(solution)
    with pytest.warns(UserWarning, match="iplw.RecordVideo records all frames"):
        assert len(new_frames(env)) == len(frames)
    env.close()


def new_frames(env: gymnasium.Env[Any, Any]) -> list[Any]:
    """What `render` returns, which must be a list."""
    frames = env.render()
    assert isinstance(frames, list)
    return frames


def frames_of(path: Path) -> int:
    """Number of frames of an mp4 file."""
    from imageio_ffmpeg import count_frames_and_secs

    return int(count_frames_and_secs(str(path))[0])


def test_rejects_incompatible_render_options(played: PlacementEnv) -> None:
    for settings, field in [({"width": 8}, "width"), ({"fps": 0}, "fps"), ({"fps": 61}, "fps")]:
        with pytest.raises(iplw.Problem) as caught:
            played.film(**settings)
        assert (caught.value.status, caught.value.field) == (422, field)
    with pytest.raises(iplw.Problem, match="pixels of a film") as caught:
        played.film(width=4096, fps=60)
    assert caught.value.status == 413
    with pytest.raises(ValueError, match=r"path is 'film.avi'; allowed: .*\.png, .*\.mp4"):
        played.film(width=64).save("film.avi")


def test_files_contain_all_frames(played: PlacementEnv, tmp_path: Path) -> None:
    film = played.film(width=96, fps=10)
    for suffix in (".png", ".apng", ".gif", ".webp"):
        path = film.save(tmp_path / f"film{suffix}")
        with Image.open(path) as picture:
            displayed = []
            frames = []
            for number in range(getattr(picture, "n_frames", 1)):
                picture.seek(number)
                frames.append(np.array(picture.convert("RGB")))
                displayed.append(picture.info["duration"])
            # Equal frames may be merged into a longer one.
            assert sum(displayed) == pytest.approx(100 * (len(film) - 1) + 1000, abs=1), suffix
            off = np.abs(frames[-1].astype(int) - film[-1]).mean()
            assert off == 0 if suffix != ".gif" else off < 0.5, suffix


def test_mp4_requires_ffmpeg(
    played: PlacementEnv, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    film = played.film(width=65, fps=10)
    if shutil.which("ffmpeg") or _has("imageio_ffmpeg"):
        path = film.save(tmp_path / "film.mp4")
        assert path.read_bytes()[4:8] == b"ftyp" and path.stat().st_size > 1000
        with pytest.raises(OSError, match="cannot write .*nowhere"):
            film.save(tmp_path / "nowhere" / "film.mp4")
    monkeypatch.setenv("PATH", "")
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(ValueError, match="requires ffmpeg.*pip install imageio-ffmpeg.*allowed without it: .png"):
        film.save(tmp_path / "film.mp4")


def _has(module: str) -> bool:
    try:
        __import__(module)
    except ImportError:
        return False
    return True


def test_async_film_of_an_action(solution: Action) -> None:
    async def films() -> tuple[bytes, bytes, int]:
        async with iplw.AsyncClient("tcp://private") as client, await client.create_world(TASK) as world:
            await world.reset()
            await world.step(solution)
            film = await world.film(width=64)
            attempted = await world.render(view="film", action=solution, width=64, fps=30)
            return film.png, attempted, await world.interactions()

    film, attempted, interactions = asyncio.run(films())
    assert film == attempted and interactions == 2, "rendering an action executes it"


def test_records_selected_episodes(tmp_path: Path) -> None:
    env = gymnasium.make("iplw/Bowling-v0", world="real")
    assert isinstance(env.unwrapped, PlacementEnv)
    folder = tmp_path / "a" / "films"
    recorded = iplw.RecordVideo(TimeLimit(env, 4), folder, lambda k: k != 1, format="png", width=64, fps=10)
    recorded.action_space.seed(0)
    valid = []
    for episode in range(4):
        recorded.reset(seed=episode)
        for _ in range(4):
            *_, ended, truncated, info = recorded.step(recorded.action_space.sample())
            if ended or truncated:
                valid.append(info["valid"])
                break
    expected = [k for k in (0, 2, 3) if valid[k]]
    assert [path.name for path in recorded.films] == [f"rl-video-episode-{k}.png" for k in expected] and expected
    assert {path.name for path in folder.iterdir()} == {path.name for path in recorded.films}
    assert env.unwrapped.world.interactions == sum(valid), "films are no interactions"
    recorded.close()


def test_records_gifs_of_wrapped_environment(tmp_path: Path) -> None:
    env = gymnasium.make("iplw/Bowling-v0")
    recorded = iplw.RecordVideo(
        Autoreset(env), tmp_path, lambda _: True, name_prefix="try", format="gif", width=64, fps=5
    )
    recorded.reset(seed=1)
    recorded.action_space.seed(1)
    ends = sum(bool(recorded.step(recorded.action_space.sample())[2]) for _ in range(10))
    assert [path.name for path in recorded.films] == [f"try-episode-{k}.gif" for k in range(ends)] and ends > 1
    assert recorded.spec is not None
    recorded.close()


def test_recorder_chooses_a_format(
    solution: Action, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def record() -> list[Path]:
        recorded = iplw.RecordVideo(gymnasium.make("iplw/Bowling-v0"), tmp_path, lambda _: True, width=64)
        recorded.reset(options={"task": TASK})
        recorded.step(solution)
        recorded.close()
        return recorded.films

    if shutil.which("ffmpeg") or _has("imageio_ffmpeg"):
        assert [path.name for path in record()] == ["rl-video-episode-0.mp4"]
    monkeypatch.setenv("PATH", "")
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.warns(UserWarning, match="films are written as gif: writing .mp4 requires.*pip install imageio-ffmpeg"):
        assert [path.name for path in record()] == ["rl-video-episode-0.gif"]
    env = gymnasium.make("iplw/Bowling-v0")
    with pytest.raises(ValueError, match="pip install imageio-ffmpeg"):
        iplw.RecordVideo(env, tmp_path, format="mp4")
    env.close()


def test_recorder_says_why_an_episode_has_no_film(tmp_path: Path) -> None:
    recorded = iplw.RecordVideo(gymnasium.make("iplw/Bowling-v0"), tmp_path, lambda k: k == 0, format="gif")
    recorded.reset(options={"task": TASK})
    outside = np.array([0.0, 0.0, 1.0], np.float32)
    assert recorded.step(outside)[-1]["valid"] is False
    with pytest.warns(UserWarning, match="episode 0 has no film, because none of its actions was valid"):
        recorded.reset()
    recorded.step(outside)
    recorded.close()
    assert recorded.films == []


def test_recorder_films_each_attempt(tmp_path: Path) -> None:
    env = gymnasium.make("iplw/Bowling-v0", max_attempts=2)
    recorded = iplw.RecordVideo(env, tmp_path, lambda _: True, format="gif", width=64, fps=5)
    recorded.action_space.seed(1)
    names = []
    for episode in range(3):
        recorded.reset(seed=episode)
        ended = truncated = False
        while not (ended or truncated):
            *_, ended, truncated, info = recorded.step(recorded.action_space.sample())
            if info["valid"]:
                names.append(f"rl-video-episode-{episode}{'-attempt-2' if info['attempt'] == 2 else ''}.gif")
    assert len(names) > 3 and [path.name for path in recorded.films] == names
    recorded.close()


def test_recorder_rejects_invalid_settings(tmp_path: Path) -> None:
    env = gymnasium.make("iplw/Bowling-v0")
    with pytest.raises(ValueError, match="format is 'avi'; allowed: png, gif, webp, mp4"):
        iplw.RecordVideo(env, tmp_path, format="avi")
    env.close()
    with pytest.raises(TypeError, match="allowed: an iplw environment"):
        iplw.RecordVideo(gymnasium.make("CartPole-v1"), tmp_path)
    envs = iplw.make_vec("bowling", 2)
    with pytest.raises(TypeError, match=r"env is a vector environment; .*`envs.film\(0\).save\(path\)`"):
        iplw.RecordVideo(envs, tmp_path)  # type: ignore[arg-type]
    envs.close()
    episodes = [k for k in range(4001) if iplw.video.capped_cubic_schedule(k)]
    assert episodes == [k**3 for k in range(11)] + [2000, 3000, 4000]
