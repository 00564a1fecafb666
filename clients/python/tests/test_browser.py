"""`render_mode="human"`: opens the web page at the environment's world once, if there is a browser."""

from __future__ import annotations

import json
import urllib.request
import webbrowser
from typing import Any

import gymnasium
import pytest

from iplw.envs import PlacementEnv
from iplw.vector import PlacementVectorEnv


@pytest.fixture
def opened_urls(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Addresses passed to a browser."""
    addresses: list[str] = []

    class Fake(webbrowser.BaseBrowser):
        def open(self, url: str, new: int = 0, autoraise: bool = True) -> bool:
            addresses.append(url)
            return True

    monkeypatch.setenv("BROWSER", "fake")
    monkeypatch.setattr(webbrowser, "_tryorder", ["fake"])
    webbrowser.register("fake", None, Fake())
    return addresses


@pytest.fixture
def no_browser(monkeypatch: pytest.MonkeyPatch) -> None:
    """No browser is available."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(webbrowser, "open", lambda _url: False)


def fetch(url: str) -> Any:
    with urllib.request.urlopen(url) as response:
        return json.load(response)


def test_opens_page_once(opened_urls: list[str]) -> None:
    env = gymnasium.make("iplw/Bowling-v0", render_mode="human")
    assert "human" in env.metadata["render_modes"]
    assert opened_urls == []
    for seed in range(3):
        env.reset(seed=seed)
        env.step(env.action_space.sample())
        assert env.render() is None
    placement = env.unwrapped
    assert isinstance(placement, PlacementEnv)
    (address,) = opened_urls
    page, _, world = address.partition("/#/live/")
    assert world == placement.world.id
    # The server serves the page and the world.
    requested = urllib.request.Request(f"{page}/", headers={"Accept": "text/html"})
    with urllib.request.urlopen(requested) as response:
        assert "text/html" in response.headers["content-type"] and b"<script" in response.read()
    assert fetch(f"{page}/v1/worlds/{world}")["state"]["episodes"] == 3
    env.close()


def test_prints_address_without_browser(no_browser: None, capsys: pytest.CaptureFixture[str]) -> None:
    env = PlacementEnv("bowling", render_mode="human")
    env.reset(seed=1)
    assert f"/#/live/{env.world.id}" in capsys.readouterr().err
    env.close()


def test_page_over_zeromq(opened_urls: list[str]) -> None:
    env = PlacementEnv("bowling", render_mode="human", url="tcp://private")
    env.reset(seed=1)
    assert opened_urls[0].startswith("http://127.0.0.1:")
    other = env.client.url
    with pytest.raises(ValueError, match="render_mode is 'human' and url is .*; allowed: the server's http address"):
        PlacementEnv("bowling", render_mode="human", url=other)
    env.close()


def test_vector_environment_shows_first_world(opened_urls: list[str]) -> None:
    envs = PlacementVectorEnv(3, "bowling", render_mode="human")
    envs.reset(seed=1)
    envs.step(envs.action_space.sample())
    assert envs.render() is None
    assert [address.rpartition("/")[2] for address in opened_urls] == envs.worlds[:1]
    envs.close()
