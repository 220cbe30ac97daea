"""Episodes that need no simulation."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from fractions import Fraction
from importlib import import_module
from pathlib import Path

import numpy as np

from mjrun.formats.codecs import encoding
from mjrun.formats.episodes import CameraVideoLayout, EpisodeLayout, EpisodeRows
from mjrun.formats.ffmpeg import VideoWriter
from mjrun.formats.output_writer import publish_together
from mjrun.model.table_column import Column

FPS = Fraction(20)
SIZE = (32, 16)
ENCODING = replace(encoding("a.mp4"), keyframe_every=2)
LAYOUT = EpisodeLayout(
    fps=FPS,
    observations=[Column("qpos/a", "rad"), Column("qvel/a", "rad/s")],
    actions=[Column("ctrl/m", "N")],
    action_low=[-1.0],
    action_high=[np.inf],
    cameras=[CameraVideoLayout("front", SIZE, ENCODING)],
    robot="<script>arm",
    origin={"command": "mjrun export `x`", "mujoco": "4.0.0"},
)
NUMBERS = replace(LAYOUT, cameras=())


def images(seed: int, count: int) -> np.ndarray:
    """Flat images, each of another grey, `(count, h, w, 3)` uint8."""
    greys = (20 + 40 * seed + 3 * np.arange(count)) % 256
    return np.broadcast_to(greys[:, None, None, None], (count, SIZE[1], SIZE[0], 3)).astype(np.uint8)


def episode(seed: int, folder: Path | None = None) -> EpisodeRows:
    """An episode of 10 + 3 · seed rows, with a video in `folder`."""
    count, random = 10 + 3 * seed, np.random.default_rng(seed)
    videos, colors = dict[str, Path](), dict[str, np.ndarray]()
    if folder is not None:
        videos["front"] = folder / f"{seed}.mp4"
        frames = images(seed, count)
        with VideoWriter(str(videos["front"]), ENCODING, SIZE, FPS, count) as writer:
            for frame in frames:
                writer.write(frame)
            writer.publish()
        colors["front"] = np.array([np.bincount(frames[..., i].ravel(), minlength=256) for i in range(3)])
    return EpisodeRows(
        task="stand" if seed % 2 else "walk",
        seed=seed,
        observations=random.normal(size=(count + 1, 2)),
        actions=random.uniform(-1, 1, (count, 1)),
        rewards=random.normal(size=count),
        terminated=seed % 2 == 0,
        truncated=seed % 2 == 1,
        success=seed == 2,
        infos={"qpos": random.normal(size=(count + 1, 3))},
        videos=videos,
        colors=colors,
    )


def episodes(seeds: Sequence[int], folder: Path | None = None) -> Iterator[EpisodeRows]:
    """Yields episodes, each made when it is needed."""
    return (episode(seed, folder) for seed in seeds)


def written(name: str, folder: Path, layout: EpisodeLayout, made: Iterator[EpisodeRows], before: int = 0) -> list[Path]:
    """Writes and publishes a dataset of the format `name`."""
    with ExitStack() as stack:
        return publish_together(
            import_module(f"mjrun.formats.episodes.{name}").write(stack, folder, layout, made, before)
        )
