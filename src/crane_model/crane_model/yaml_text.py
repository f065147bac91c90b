"""YAML text to plain content, within limits: a small text that grows without end is refused."""

from collections.abc import Iterator, Sequence
from typing import Any

import yaml
from yaml.composer import ComposerError
from yaml.constructor import ConstructorError

from crane_model.wording import shown

DEEPEST = 40  # mappings and lists within each other
MOST = 200_000  # values, those behind an alias counted wherever it stands
LONGEST_NUMBER = 100  # characters of a number or a date: the arithmetic of long ones takes hours


class WrongYamlError(Exception):
    """What is wrong with the text, with line and key where it has them."""


class YamlText:
    """Parsed YAML: its plain `content`, and the line on which each part of it stands.

    Raises `WrongYamlError` if the text is not YAML, a value is not what its tag says, a key stands
    twice in one mapping, or a limit is passed.
    """

    def __init__(self, text: str):
        self._root: yaml.Node | None = None
        self._parts: dict[yaml.Node | None, dict[str, yaml.Node]] = {}
        try:
            loader = _Loader(text)
            self._root = loader.get_single_node()
            self.content: Any = None
            if self._root is not None:
                _count(self._root, {})
                self.content = loader.construct_document(self._root)
        except yaml.MarkedYAMLError as error:
            raise WrongYamlError(self._told(error)) from None
        except yaml.YAMLError as error:  # of a single character
            raise WrongYamlError(f"not valid YAML: {' '.join(str(error).split())}") from None

    def line(self, place: Sequence[int | str]) -> int:
        """Line, from 1, of what stands at `place` (keys and indices), or of what would hold it."""
        node = self._root
        for part in place:
            if node not in self._parts:
                self._parts[node] = dict(_parts(node))
            inner = self._parts[node].get(str(part))
            if inner is None:
                break
            node = inner
        return 1 if node is None else node.start_mark.line + 1

    def _told(self, error: yaml.MarkedYAMLError) -> str:
        mark = error.problem_mark or error.context_mark
        if error.context == "while scanning a simple key":  # it is found out on the next line
            mark = error.context_mark
        assert mark is not None  # that is what PyYAML means by marked
        key = ".".join(_way(self._root, mark.index)) if self._root else ""
        place = f"line {mark.line + 1}: " + (f"key '{key}': " if key else "")
        if isinstance(error, _RefusedError):
            return f"{place}{error.problem}"
        what = "; ".join(one for one in (error.context, error.problem) if one)
        return f"{place}not valid YAML: {what}"


class _RefusedError(ConstructorError):
    """What is YAML, but not ours."""

    def __init__(self, problem: str, node: yaml.Node):
        super().__init__(None, None, problem, node.start_mark)


class _Loader(yaml.SafeLoader):
    _depth = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        self._depth += 1
        if self._depth > DEEPEST:
            problem = f"nested deeper than {DEEPEST} levels; write it flatter"
            event = self.peek_event()  # type: ignore[no-untyped-call]
            raise ComposerError(None, None, problem, event.start_mark)
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        kind = node.tag.rpartition(":")[2]
        try:
            if kind in {"int", "float", "timestamp"} and len(node.value) > LONGEST_NUMBER:
                raise ValueError
            return super().construct_object(node, deep)
        except yaml.YAMLError:
            raise
        except Exception:  # whatever Python says of a month 13 or a number without digits
            raise _RefusedError(f"no valid {kind}{shown(node.value)}", node) from None

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if key.value in seen:
                raise _RefusedError(f"the key '{key.value}' stands twice in one mapping", key)
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def _parts(node: yaml.Node | None) -> Iterator[tuple[str, yaml.Node]]:
    """Key or index, and node, of all that stands right within a node."""
    if isinstance(node, yaml.MappingNode):
        yield from ((str(key.value), value) for key, value in node.value)
    elif isinstance(node, yaml.SequenceNode):
        yield from ((str(i), value) for i, value in enumerate(node.value))


def _way(node: yaml.Node, index: int) -> Iterator[str]:
    """Keys and indices down to the character `index` of the text."""
    for key, inner in _parts(node):
        begin, end = inner.start_mark.index, inner.end_mark.index
        if node.start_mark.index < begin <= index <= end:  # an alias stands elsewhere
            yield key
            yield from _way(inner, index)
            return


def _count(node: yaml.Node, counted: dict[int, int]) -> int:
    """Values in a node, aliases followed; `counted` holds those of the nodes that were met."""
    if id(node) not in counted:
        counted[id(node)] = MOST + 1  # until it is known: of a node that holds itself
        total = 1
        for _, inner in _parts(node):
            total += _count(inner, counted)
            if total > MOST:
                raise _RefusedError(
                    f"holds more than {MOST} values, those of aliases counted wherever they stand; "
                    "write fewer",
                    node,
                )
        counted[id(node)] = total
    return counted[id(node)]
