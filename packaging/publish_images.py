"""The step of action.yml that shows images in the summary and in the comment on the pull request.

GitHub strips `data:` addresses from Markdown, and shows no files of artifacts. Images are therefore committed to the
branch mjrun-images of the repository, which shares no history with its other branches, and are linked by that commit.
Each commit holds only its own images. REPORT is the report that the comment will contain, FILES lists written files.
"""

import base64
import html
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any
from urllib.parse import quote

BRANCH = "mjrun-images"
SUFFIXES = (".png", ".gif", ".webp", ".jpg", ".jpeg")
LARGEST = 5_000_000  # bytes of an image that GitHub shows
MOST = 20  # images of a comment
TRIES = 5  # another job may push meanwhile


class RefusedError(Exception):
    """A request that GitHub refuses."""


def main() -> None:
    """Pushes the images and appends them to the report and the summary; without permission, warns and goes on."""
    paths = [Path(line) for line in os.environ["FILES"].splitlines()]
    images = [path for path in paths if path.suffix.lower() in SUFFIXES and path.stat().st_size <= LARGEST]
    if not images:
        return
    shown = {os.path.relpath(path).replace(os.sep, "/").replace("../", ""): path for path in images[:MOST]}
    try:
        commit = push(shown)
    except RefusedError as error:
        reason = " ".join(str(error).split())
        sys.stdout.write(f"::warning title=Images are not shown::{reason}; the job needs contents: write\n")
        return
    text = markdown(shown, commit, len(images) - len(shown))
    for variable in ("REPORT", "GITHUB_STEP_SUMMARY"):
        with Path(os.environ[variable]).open("a", encoding="utf-8") as file:
            file.write(text)


def push(images: dict[str, Path]) -> str:
    """Commits images, by their names, to the branch, and returns the commit.

    Raises:
      RefusedError: GitHub refuses it, as it does in workflows of forks.
    """
    tree = [{"path": name, "mode": "100644", "type": "blob", "sha": blob(path)} for name, path in images.items()]
    tree_sha = ask("POST", "git/trees", tree=tree)["sha"]
    message = f"Show images of {os.environ.get('GITHUB_RUN_ID', 'a run')}"
    for attempt in range(1, TRIES + 1):
        heads = ask("GET", f"git/matching-refs/heads/{BRANCH}")
        head = next((ref["object"]["sha"] for ref in heads if ref["ref"] == f"refs/heads/{BRANCH}"), None)
        parents = [head] if head else []
        commit = ask("POST", "git/commits", message=message, tree=tree_sha, parents=parents)["sha"]
        try:
            if head:
                ask("PATCH", f"git/refs/heads/{BRANCH}", sha=commit)
            else:
                ask("POST", "git/refs", ref=f"refs/heads/{BRANCH}", sha=commit)
        except RefusedError:
            if attempt == TRIES:
                raise
        else:
            return commit
    raise AssertionError


def blob(path: Path) -> str:
    """Uploads the content of a file, and returns its name in git."""
    return ask("POST", "git/blobs", content=base64.b64encode(path.read_bytes()).decode(), encoding="base64")["sha"]


def ask(method: str, path: str, **fields: object) -> Any:
    """Sends a request to GitHub about this repository, and returns the answer.

    Raises:
      RefusedError: GitHub refuses it.
    """
    command = ["gh", "api", f"repos/{os.environ['GITHUB_REPOSITORY']}/{path}", "--method", method]
    if fields:
        command += ["--input", "-"]
    done = subprocess.run(command, input=json.dumps(fields).encode(), capture_output=True, check=False)
    if done.returncode:
        raise RefusedError(done.stderr.decode("utf-8", "replace").strip())
    return json.loads(done.stdout)


def markdown(images: dict[str, Path], commit: str, more: int) -> str:
    """Returns the images, each below its name."""
    home = f"{os.environ['GITHUB_SERVER_URL']}/{os.environ['GITHUB_REPOSITORY']}/blob/{commit}"
    parts = [
        f'<p>{html.escape(name)}<br><img src="{home}/{quote(name)}?raw=true" alt="{html.escape(name)}"></p>\n'
        for name in images
    ]
    rest = [f"{more} more images are in the artifact.\n"] if more else []
    return "\n".join(["", *parts, *rest])


if __name__ == "__main__":
    sys.exit(main())
