"""Settings of the OpenEnv server, from the command line."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

#: Optional fields of observations.
OPTIONAL_FIELDS = ("scene", "picture")


@dataclass(frozen=True)
class Settings:
    """Worlds of the sessions, and limits."""

    #: A family (`bowling`) or one task of it (`bowling:017`); None with a `scene` in `world`.
    task: str | None = "bowling"
    #: `sim`, `real`, or the settings of `Client.create_world`: `{"kind": "real", "damping": 0.8}`.
    world: str | Mapping[str, Any] = "sim"
    #: Default split of `reset`.
    split: str = "train"
    #: Optional fields of observations: `scene`, `picture`.
    show: tuple[str, ...] = ()
    #: Maximum number of real interactions over all sessions; None for no limit.
    budget: int | None = None
    #: Maximum number of concurrent sessions.
    sessions: int = 64
    #: Idle time after which the world of a session is deleted, s; None for never.
    idle: float | None = 3600.0
    #: Address of an iplw server; None for a private one.
    url: str | None = None
    #: Allowed origins of web pages, in addition to pages of this server.
    origins: tuple[str, ...] = ()
    #: Allowed host names, in addition to IP addresses and `localhost`.
    hosts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if unknown := sorted(set(self.show) - set(OPTIONAL_FIELDS)):
            raise ValueError(f"show is {unknown}; allowed: {', '.join(OPTIONAL_FIELDS)}")
        if self.sessions < 1:
            raise ValueError(f"sessions is {self.sessions}; allowed: 1 or more")
        if self.idle is not None and not self.idle > 0:
            raise ValueError(f"idle is {self.idle}; allowed: more than 0 s")


def parser() -> argparse.ArgumentParser:
    """The command line of `python -m iplw.openenv`."""
    about = "Serves iplw worlds to OpenEnv clients."
    parser = argparse.ArgumentParser(prog="python -m iplw.openenv", description=about)
    parser.add_argument("--task", default="bowling", help="a family (bowling) or one task of it (bowling:017)")
    settings = 'sim, real, or settings: {"kind": "real", "damping": 0.8}'
    parser.add_argument("--world", default="sim", type=_world, help=settings)
    parser.add_argument("--scene", type=_document, metavar="FILE", help="an iplw.scene/1 document instead of a task")
    parser.add_argument("--split", default="train", choices=("train", "validation", "test"), help="default split of reset")
    parser.add_argument("--show", action="append", default=[], choices=OPTIONAL_FIELDS, help="add a field to observations")
    parser.add_argument("--budget", type=int, help="maximum number of real interactions over all sessions (default: no limit)")
    parser.add_argument("--sessions", type=int, default=64, help="maximum number of concurrent sessions (64)")
    parser.add_argument("--idle", type=float, default=3600.0, metavar="S", help="idle time after which a session's world is deleted (3600)")
    parser.add_argument("--url", help="address of an iplw server (default: IPLW_URL, or a private one)")
    parser.add_argument("--allow-origin", action="append", default=[], help="allow web pages of another origin to connect")
    parser.add_argument("--allow-host", action="append", default=[], help="allow another host name for this server")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (127.0.0.1); there is no authentication")
    parser.add_argument("--port", type=int, default=8000, help="port to listen on (8000); 0 for a free one")
    return parser


def settings_of(arguments: argparse.Namespace) -> Settings:
    """The settings of a command line."""
    world = arguments.world
    if arguments.scene is not None:
        world = {**({"kind": world} if isinstance(world, str) else world), "scene": arguments.scene}
    return Settings(
        task=arguments.task if arguments.scene is None else None,
        world=world,
        split=arguments.split,
        show=tuple(arguments.show),
        budget=arguments.budget,
        sessions=arguments.sessions,
        idle=arguments.idle,
        url=arguments.url,
        origins=tuple(arguments.allow_origin),
        hosts=tuple(arguments.allow_host),
    )


def read(arguments: Sequence[str] | None = None) -> tuple[argparse.Namespace, Settings]:
    """The parsed arguments and the settings; exits with a message if a value is invalid."""
    command = parser()
    options = command.parse_args(arguments)
    try:
        return options, settings_of(options)
    except ValueError as error:
        command.error(str(error))


def _world(text: str) -> str | dict[str, Any]:
    if not text.lstrip().startswith("{"):
        return text
    parser: dict[str, Any] = json.loads(text)
    return parser


def _document(path: str) -> dict[str, Any]:
    try:
        with open(path, encoding="utf-8") as file:
            parser: dict[str, Any] = json.load(file)
    except (OSError, ValueError) as error:
        raise argparse.ArgumentTypeError(f"{path}: {error}") from error
    return parser
