"""A film of what a step brought: frames as arrays, and files that others play."""

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

#: How long a film shows its end, ms.
REST = 1000


class Film:
    """What a step brought, `fps` frames a second, from what was placed to the end, which is shown for a second.

    `len(film)`, `film[i]` and iteration give frames; a notebook plays it.
    """

    def __init__(self, png: bytes, fps: int) -> None:
        #: The film as an animated PNG.
        self.png = png
        #: Frames a second.
        self.fps = fps

    @cached_property
    def frames(self) -> NDArray[np.uint8]:
        """(n, height, width, 3) RGB, read once."""
        return np.stack(list(_frames(self.png)))

    @property
    def duration(self) -> float:
        """From the first frame to the last, s."""
        return (len(self) - 1) / self.fps

    def save(self, path: str | PathLike[str]) -> Path:
        """Writes it as `.png` or `.apng` (animated), `.gif`, `.webp`, or, where ffmpeg is, `.mp4`; gives the path.

        A GIF counts in hundredths of a second: where `fps` does not divide 100, the time of a frame is rounded to one,
        and above 50 frames a second each is shown for 2, since players take 1 for 10.
        """
        path = Path(path)
        write = _WRITERS.get(path.suffix.lower())
        if write is None:
            raise ValueError(f"path is {str(path)!r}; allowed: a name that ends with {', '.join(_WRITERS)}")
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
        return f"<Film of {len(self)} frames, {self.duration:.2f} s at {self.fps} a second, {width} x {height}>"

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
    # Colours of the whole film: each frame's own would flicker.
    palette = _palette(film.frames)
    frames = [Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in film]
    shown = max(2, round(100 / film.fps)) * 10
    _animate(path, frames, shown)


def _write_webp(film: Film, path: Path) -> None:
    _animate(path, [Image.fromarray(frame) for frame in film], round(1000 / film.fps))


def _animate(path: Path, frames: list[Image.Image], shown: int) -> None:
    """Frames in a file of Pillow's, `shown` ms each, the last for a second; without loss, where there is a choice."""
    times = [shown] * (len(frames) - 1) + [REST]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=times, loop=0, lossless=True)


def _palette(frames: NDArray[np.uint8]) -> Image.Image:
    """256 colours of some frames spread over the film: the 64 most frequent as they are, the others grouped by likeness."""
    some = frames[np.unique(np.linspace(0, len(frames) - 1, 8).astype(int))].reshape(-1, 3).astype(np.uint32)
    packed, counts = np.unique(some @ np.array([65536, 256, 1], np.uint32), return_counts=True)
    colours = np.stack([packed >> 16, packed >> 8 & 255, packed & 255], axis=1).astype(np.uint8)
    colours = _apart(colours[np.argsort(-counts, kind="stable")])
    if len(colours) > 256:
        # Each once, however large what it fills: the white around would take all.
        grouped = Image.fromarray(colours[None, 64:]).quantize(192).getpalette() or []
        colours = _apart(np.concatenate([colours[:64], np.array(grouped, np.uint8).reshape(-1, 3)[:192]]))
    palette = Image.new("P", (1, 1))
    palette.putpalette(colours.tobytes())
    return palette


def _apart(colours: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The first of those that Pillow does not tell apart when it looks for a palette's nearest: it drops two bits."""
    boxes = (colours >> 2).astype(np.uint32) @ np.array([65536, 256, 1], np.uint32)
    kept: NDArray[np.uint8] = colours[np.sort(np.unique(boxes, return_index=True)[1])]
    return kept


def _write_mp4(film: Film, path: Path) -> None:
    encoder = _ffmpeg()
    _, height, width, _ = film.frames.shape
    given = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(film.fps), "-i", "-"]
    # Its usual form of colour halves both sides, so they must be even.
    even = ["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white", "-pix_fmt", "yuv420p"]
    rest = np.repeat(film.frames[-1:], film.fps * REST // 1000, axis=0)
    run = subprocess.run(
        [encoder, "-loglevel", "error", "-y", *given, *even, str(path)],
        input=film.frames.tobytes() + rest.tobytes(),
        capture_output=True,
        check=False,
    )
    if run.returncode != 0:
        raise OSError(f"{encoder} cannot write {path}: {run.stderr.decode(errors='replace').strip()}")


def _ffmpeg() -> str:
    """A program that writes MP4: on PATH, or the one that comes with imageio-ffmpeg (moviepy has it)."""
    if found := shutil.which("ffmpeg"):
        return found
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        return str(get_ffmpeg_exe())
    except (ImportError, RuntimeError) as error:
        raise ValueError(
            "a film as .mp4 needs ffmpeg, which is not on PATH; install it or `pip install imageio-ffmpeg`; "
            "allowed without it: .png, .gif, .webp"
        ) from error


_WRITERS: dict[str, Callable[[Film, Path], None]] = {
    ".png": _write_png,
    ".apng": _write_png,
    ".gif": _write_gif,
    ".webp": _write_webp,
    ".mp4": _write_mp4,
}
