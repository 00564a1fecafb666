"""Films of rollouts: frames as arrays, and video files."""

from __future__ import annotations

import base64
import io
import shutil
import subprocess
from collections.abc import Callable, Iterator
from functools import cached_property
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

#: An array (height, width, 3) of uint8.
Frame = NDArray[np.uint8]

#: Duration of the last frame in a file, ms.
END_HOLD_MS = 1000


class Film:
    """The frames of one step, `fps` per second, from the placement to the end.

    `len(film)`, `film[i]` and iteration give frames; a notebook plays the film.
    """

    def __init__(self, png: bytes, fps: int) -> None:
        #: The film as an animated PNG.
        self.png = png
        #: Frames per second.
        self.fps = fps

    @cached_property
    def frames(self) -> NDArray[np.uint8]:
        """(n, height, width, 3) RGB, decoded once."""
        return np.stack(list(_frames(self.png)))

    @property
    def duration(self) -> float:
        """Time from the first to the last frame, s."""
        return (len(self) - 1) / self.fps

    def save(self, path: str | PathLike[str]) -> Path:
        """Writes `.png` or `.apng` (animated), `.gif`, `.webp`, or `.mp4` if ffmpeg is installed; returns the path.

        GIF stores durations in hundredths of a second: the duration of a frame is rounded to it and is at least 2, because
        players change 1 to 10.
        """
        path = Path(path)
        write = _WRITERS.get(path.suffix.lower())
        if write is None:
            raise ValueError(f"path is {str(path)!r}; allowed: a suffix of {', '.join(_WRITERS)}")
        write(self, path)
        return path

    def __len__(self) -> int:
        return len(self.frames)

    def __iter__(self) -> Iterator[Frame]:
        return iter(self.frames)

    def __getitem__(self, index: int) -> Frame:
        frame: Frame = self.frames[index]
        return frame

    def __repr__(self) -> str:
        _, height, width, _ = self.frames.shape
        return f"<Film of {len(self)} frames, {self.duration:.2f} s at {self.fps} fps, {width} x {height}>"

    def _repr_html_(self) -> str:
        return f'<img alt="film" src="data:image/apng;base64,{base64.b64encode(self.png).decode()}">'


def _frames(png: bytes) -> Iterator[Frame]:
    with Image.open(io.BytesIO(png), formats=["PNG"]) as film:
        for number in range(getattr(film, "n_frames", 1)):
            film.seek(number)
            yield np.array(film.convert("RGB"))


def _write_png(film: Film, path: Path) -> None:
    path.write_bytes(film.png)


def _write_gif(film: Film, path: Path) -> None:
    # One palette for all frames: separate palettes would flicker.
    palette = _palette(film.frames)
    frames = [Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in film]
    frame_ms = max(2, round(100 / film.fps)) * 10
    _animate(path, frames, frame_ms)


def _write_webp(film: Film, path: Path) -> None:
    _animate(path, [Image.fromarray(frame) for frame in film], round(1000 / film.fps))


def _animate(path: Path, frames: list[Image.Image], frame_ms: int) -> None:
    """Writes frames with Pillow, `frame_ms` each and the last for `END_HOLD_MS`; lossless if the format allows."""
    times = [frame_ms] * (len(frames) - 1) + [END_HOLD_MS]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=times, loop=0, lossless=True)


def _palette(frames: NDArray[np.uint8]) -> Image.Image:
    """256 colours from 8 frames: the 64 most frequent unchanged, the others quantised."""
    sample = frames[np.unique(np.linspace(0, len(frames) - 1, 8).astype(int))].reshape(-1, 3).astype(np.uint32)
    packed, counts = np.unique(sample @ np.array([65536, 256, 1], np.uint32), return_counts=True)
    colours = np.stack([packed >> 16, packed >> 8 & 255, packed & 255], axis=1).astype(np.uint8)
    colours = _distinct(colours[np.argsort(-counts, kind="stable")])
    if len(colours) > 256:
        # Each colour once: by frequency, white would take all entries.
        grouped = Image.fromarray(colours[None, 64:]).quantize(192).getpalette() or []
        colours = _distinct(np.concatenate([colours[:64], np.array(grouped, np.uint8).reshape(-1, 3)[:192]]))
    palette = Image.new("P", (1, 1))
    palette.putpalette(colours.tobytes())
    return palette


def _distinct(colours: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The colours that remain distinct in Pillow's palette search, which ignores the two lowest bits."""
    boxes = (colours >> 2).astype(np.uint32) @ np.array([65536, 256, 1], np.uint32)
    distinct: NDArray[np.uint8] = colours[np.sort(np.unique(boxes, return_index=True)[1])]
    return distinct


def _write_mp4(film: Film, path: Path) -> None:
    encoder = ffmpeg()
    _, height, width, _ = film.frames.shape
    input_arguments = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(film.fps), "-i", "-"]
    # yuv420p requires even width and height.
    filters = ["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white", "-pix_fmt", "yuv420p"]
    held_frames = np.repeat(film.frames[-1:], film.fps * END_HOLD_MS // 1000, axis=0)
    run = subprocess.run(
        [encoder, "-loglevel", "error", "-y", *input_arguments, *filters, str(path)],
        input=film.frames.tobytes() + held_frames.tobytes(),
        capture_output=True,
        check=False,
    )
    if run.returncode != 0:
        raise OSError(f"{encoder} cannot write {path}: {run.stderr.decode(errors='replace').strip()}")


def ffmpeg() -> str:
    """The ffmpeg executable: on PATH, or from imageio-ffmpeg (installed by moviepy); `ValueError` if there is none."""
    if found := shutil.which("ffmpeg"):
        return found
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        return str(get_ffmpeg_exe())
    except (ImportError, RuntimeError) as error:
        raise ValueError(
            "writing .mp4 requires ffmpeg, which is not on PATH; install it or `pip install imageio-ffmpeg`; "
            "allowed without it: .png, .gif, .webp"
        ) from error


_WRITERS: dict[str, Callable[[Film, Path], None]] = {
    ".png": _write_png,
    ".apng": _write_png,
    ".gif": _write_gif,
    ".webp": _write_webp,
    ".mp4": _write_mp4,
}
