"""Fast reading of YAML from files of unknown origin, and fast writing."""

import re
from typing import Any

import yaml

LARGEST_YAML = 1 << 20
"""Limit on the number of characters of a configuration, and on the number of values in any YAML
text after aliases are replaced. Reading so much text takes a few seconds."""

FLOAT = (
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)[eE][-+]?[0-9]+\Z"),
    list("-+.0123456789"),
)
"""Tag, pattern and first characters of numbers with an exponent that YAML 1.1 reads as texts"""

# Errors of PyYAML's constructors if a value does not fit its explicit tag, as in `!!bool maybe`.
_UNFIT = (AttributeError, IndexError, KeyError, TypeError)


class SafeLoader(yaml.composer.Composer, yaml.CSafeLoader):
    """YAML loader for plain values, which are limited in number and cannot contain themselves.

    libyaml parses the text, and Python code composes the nodes, because deep nesting would crash
    libyaml's composer.
    """

    def __init__(self, text: str) -> None:
        yaml.CSafeLoader.__init__(self, text)
        yaml.composer.Composer.__init__(self)
        self._count = 0  # values composed so far, with the values that each alias repeats
        self._counts: dict[yaml.Node, int] = {}  # number of values of each complete node

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Return the next node of the document.

        Raises:
            yaml.composer.ComposerError: a value contains an alias of itself, or the document has
                more than `LARGEST_YAML` values.
        """
        event: Any = self.peek_event()
        mark, before = event.start_mark, self._count
        alias = isinstance(event, yaml.AliasEvent)
        node: Any = super().compose_node(parent, index)
        if alias and node not in self._counts:
            raise yaml.composer.ComposerError(None, None, "a value contains itself", mark)
        self._count += self._counts[node] if alias else 1
        if self._count > LARGEST_YAML:
            problem = f"it has more than {LARGEST_YAML} values, with those that aliases repeat"
            raise yaml.composer.ComposerError(None, None, problem, mark)
        if not alias:
            self._counts[node] = self._count - before
        return node

    def construct_document(self, node: yaml.Node) -> Any:
        """Construct nested values immediately, so that errors name the position of a value."""
        return self.construct_object(node, deep=True)

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """Construct a value; reject a value that does not match its YAML tag."""
        try:
            return super().construct_object(node, deep)
        except _UNFIT:
            problem = f"a value does not fit its tag {node.tag}"
            raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark) from None


class _Dumper(yaml.CSafeDumper):
    """Writer that quotes a text which a reader of `FLOAT` would read as a number, like 3e57."""


_Dumper.add_implicit_resolver(*FLOAT)


def in_yaml(document: Any) -> str:
    """Return a document as YAML, with all keys in their order."""
    return str(yaml.dump(document, Dumper=_Dumper, sort_keys=False))
