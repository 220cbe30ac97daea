"""Minari datasets: a folder with the episodes of a policy, without images."""

from mjrun.outputs.exports import ExportFormat

FORMAT = ExportFormat(
    "minari",
    (),
    "Minari dataset of episodes, for offline reinforcement learning",
    product="mjrun.study.episode_dataset:EpisodeDataset",
)
