"""Hashes of the contents of files, each computed once for each version of a file."""

import hashlib
import time

from mjrun.file_version import file_version, is_settled


class FileDigestCache:
    """A cache of the hashes of files in memory: one that has neither been replaced nor written is read only once."""

    def __init__(self) -> None:
        self._digests: dict[tuple[object, ...], str] = {}

    def of(self, place: str) -> str:
        """Returns the SHA-256 of a regular file; an empty text if it is missing."""
        since, version = time.time_ns(), file_version(place)
        if version is None:
            return ""
        digest = self._digests.get((place, *version))
        if digest is None:
            try:
                with open(place, "rb") as file:  # noqa: PTH123 – of thousands; pathlib takes longer
                    digest = hashlib.file_digest(file, "sha256").hexdigest()
            except OSError:
                return ""
            if is_settled(version, since):
                self._digests[place, *version] = digest
        return digest
