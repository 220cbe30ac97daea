"""Tasks: what a policy observes, what its actions do, what is rewarded, and when an episode ends."""
