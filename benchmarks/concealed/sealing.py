"""Files of a case and their seals: what is written before is hashed before."""

import hashlib
import json
from pathlib import Path

__all__ = ["read_json", "sha256", "write_json"]


def sha256(path: Path) -> str:
    """Return the digest of a file's bytes."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def write_json(path: Path, content) -> str:
    """Write `content` and return the file's digest."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=1, default=_plain) + "\n", encoding="utf-8")
    return sha256(path)


def read_json(path: Path):
    return json.loads(Path(path).read_text(encoding="utf-8"))


def _plain(value):
    """Turn numpy's numbers and arrays into what JSON knows."""
    return value.tolist()
