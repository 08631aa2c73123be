"""YAML that nobody vouches for: plain values only, keys given once, and no more than is plausible.

What builds objects is refused by the safe loader. Maps that are merged into each other and lists of
aliases stay as small as their text, since what they repeat is shared.
"""

from __future__ import annotations

from collections.abc import Hashable
from pathlib import Path
from typing import Any

import yaml

MAX_BYTES = 100_000
"""PyYAML takes some seconds for as much."""

# what PyYAML raises beside YAMLError on broken scalars and bottomless nesting
_FAULTS = (ValueError, TypeError, AttributeError, LookupError, RecursionError, OverflowError)


class YamlError(ValueError):
    """A text is no YAML, or YAML that is not taken; with the one-based line where that is known."""

    def __init__(self, what: str, line: int | None = None) -> None:
        self.line = line
        super().__init__(what)


def parse_yaml(text: str) -> Any:
    """The value of a text of YAML.

    Raises
    ------
    YamlError
        Where it is malformed, repeats a key or asks for objects.
    """
    try:
        return yaml.load(text, Loader=_UniqueKeyLoader)  # nosec B506: a safe loader
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else None
        raise YamlError(f"not YAML: {error.problem or error.context}", line) from error
    except (yaml.YAMLError, *_FAULTS) as error:
        raise YamlError(f"not readable as YAML: {error}") from error


def read_yaml_file(path: Path) -> Any:
    """The value of a YAML file of at most `MAX_BYTES`.

    Raises
    ------
    YamlError
        Where it cannot be read, is larger, or is refused by `parse_yaml`.
    """
    try:
        with path.open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
        if len(data) > MAX_BYTES:
            raise YamlError(f"larger than {MAX_BYTES} bytes; that is no description")
        text = data.decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise YamlError(f"not readable as YAML: {error}") from error
    return parse_yaml(text)


class _UniqueKeyLoader(yaml.SafeLoader):
    """The safe loader, but a key that is given twice is an error: neither would get lost."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[Any] = set()
        for key_node, _ in node.value:
            if key_node.tag == "tag:yaml.org,2002:merge":
                continue
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, Hashable) and key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"the key '{key}' is given twice", key_node.start_mark
                )
            seen.add(key)
        return super().construct_mapping(node, deep=deep)
