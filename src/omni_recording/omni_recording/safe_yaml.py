"""Fast reading of YAML from files of unknown origin."""

import yaml


class SafeLoader(yaml.composer.Composer, yaml.CSafeLoader):
    """YAML loader for plain values.

    libyaml parses the text and Python composes it, because deep nesting would crash libyaml's
    composer.
    """

    def __init__(self, text: str) -> None:
        yaml.CSafeLoader.__init__(self, text)
        yaml.composer.Composer.__init__(self)
