"""What a server is started with, from a command line."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

#: What an observation may hold beside features.
SHOWN = ("scene", "picture")


@dataclass(frozen=True)
class Settings:
    """What worlds the sessions get, and how many there may be."""

    #: A family (`bowling`) or one task of it (`bowling:017`); None with a `scene` in `world`.
    task: str | None = "bowling"
    #: `sim`, `real`, or the settings of `Client.create_world`: `{"kind": "real", "damping": 0.8}`.
    world: str | Mapping[str, Any] = "sim"
    #: What `reset` draws tasks from, if it does not say.
    split: str = "train"
    #: What observations hold beside features: `scene`, `picture`.
    show: tuple[str, ...] = ()
    #: Real interactions of all sessions together; None for any number.
    budget: int | None = None
    #: Most sessions at once; one more is refused.
    sessions: int = 64
    #: A session that does nothing for so long loses its world, s; None for never.
    idle: float | None = 3600.0
    #: Address of an iplw server; None for a private one.
    url: str | None = None
    #: Origins of pages that may connect, beside those that the server itself serves.
    origins: tuple[str, ...] = ()
    #: Names that the server may be called by, beside addresses and `localhost`.
    hosts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if unknown := sorted(set(self.show) - set(SHOWN)):
            raise ValueError(f"show is {unknown}; allowed: {', '.join(SHOWN)}")
        if self.sessions < 1:
            raise ValueError(f"sessions is {self.sessions}; allowed: from 1")
        if self.idle is not None and not self.idle > 0:
            raise ValueError(f"idle is {self.idle}; allowed: more than 0 s")


def parser() -> argparse.ArgumentParser:
    """The command line of `python -m iplw.openenv`."""
    about = "Worlds of iplw, for OpenEnv's clients."
    made = argparse.ArgumentParser(prog="python -m iplw.openenv", description=about)
    made.add_argument("--task", default="bowling", help="a family (bowling) or one task of it (bowling:017)")
    settings = 'sim, real, or settings: {"kind": "real", "damping": 0.8}'
    made.add_argument("--world", default="sim", type=_world, help=settings)
    made.add_argument("--scene", type=_document, metavar="FILE", help="an iplw.scene/1 document instead of a task")
    made.add_argument("--split", default="train", choices=("train", "validation", "test"), help="what reset draws from")
    made.add_argument("--show", action="append", default=[], choices=SHOWN, help="more that observations hold")
    made.add_argument("--budget", type=int, help="real interactions of all sessions together (default: any number)")
    made.add_argument("--sessions", type=int, default=64, help="most sessions at once (64)")
    made.add_argument("--idle", type=float, default=3600.0, metavar="S", help="an idle session loses its world (3600)")
    made.add_argument("--url", help="an iplw server (default: IPLW_URL, or a private one)")
    made.add_argument("--allow-origin", action="append", default=[], help="a page of another origin that may connect")
    made.add_argument("--allow-host", action="append", default=[], help="a name that the server may be called by")
    made.add_argument("--host", default="127.0.0.1", help="address to listen on (127.0.0.1); there are no tokens")
    made.add_argument("--port", type=int, default=8000, help="port to listen on (8000); 0 takes a free one")
    return made


def settings_of(given: argparse.Namespace) -> Settings:
    """The settings of a command line."""
    world = given.world
    if given.scene is not None:
        world = {**({"kind": world} if isinstance(world, str) else world), "scene": given.scene}
    return Settings(
        task=given.task if given.scene is None else None,
        world=world,
        split=given.split,
        show=tuple(given.show),
        budget=given.budget,
        sessions=given.sessions,
        idle=given.idle,
        url=given.url,
        origins=tuple(given.allow_origin),
        hosts=tuple(given.allow_host),
    )


def read(arguments: Sequence[str] | None = None) -> tuple[argparse.Namespace, Settings]:
    """What was given, and the settings of it; ends the program with a line where it is not allowed."""
    command = parser()
    given = command.parse_args(arguments)
    try:
        return given, settings_of(given)
    except ValueError as error:
        command.error(str(error))


def _world(text: str) -> str | dict[str, Any]:
    if not text.lstrip().startswith("{"):
        return text
    made: dict[str, Any] = json.loads(text)
    return made


def _document(path: str) -> dict[str, Any]:
    try:
        with open(path, encoding="utf-8") as file:
            made: dict[str, Any] = json.load(file)
    except (OSError, ValueError) as error:
        raise argparse.ArgumentTypeError(f"{path}: {error}") from error
    return made
