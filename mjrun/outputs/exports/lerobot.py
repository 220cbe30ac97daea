"""LeRobot datasets: a folder with the episodes of a policy, or of a recording, and a video for each camera."""

from mjrun.outputs.exports import ExportFormat

FORMAT = ExportFormat(
    "lerobot",
    (),
    "LeRobot dataset v3 of episodes, for imitation learning",
    product="mjrun.study.episode_dataset:EpisodeDataset",
)
