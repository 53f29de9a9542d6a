"""Reading of robot descriptions, and expansion of xacro files without their Python.

xacro evaluates ``${...}`` as Python, from which an expression can reach any module of the process
through attributes of functions and generators. So the expressions of a file are parsed first, and
those that need more than arithmetic, texts, lists and xacro's own functions are refused.
"""

import ast
import contextlib
import glob
import importlib
import io
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from omni_core.configuration import ConfigurationError, did_you_mean
from omni_core.files import read_text
from omni_core.plugins import import_optional
from omni_tools.robot_files.refusal import refused

# Attributes that lead to the interpreter, and functions that reach them by a text.
_SPECIAL = re.compile(r"_|(gi|cr|ag|tb|co)_|f_(back|builtins|code|globals|locals)$")
_REFLECTION = ("vars", "type")
_FIND = re.compile(r"\$\(find\s+([^)\s]+)\s*\)|find\('([^']+)'\)|package://([\w-]+)/")
_ARGUMENT = re.compile(
    r"<xacro:arg\b[^>]*?\bname\s*=\s*[\"']([\w-]+)|\$\(arg\s+([\w-]+)|xacro\.arg\(['\"]([\w-]+)"
)
_ABSENT = "/absent"  # folder that stands for those of missing packages
# What a file lacks, keyed by what xacro says; {0} is the group, {1} the whole text.
_REASONS = {
    r"[Pp]ackage '?([\w-]+)'? not found": "the package {0} is not in the folders around it; put "
    "its folder next to them, source a workspace that has it, or leave out what it contains by "
    "--skip-missing",
    r"No such file or directory: '([^']+)'": "lacks the file {0}",
    r"Undefined substitution argument (\S+)": "the argument {0} has no value",
    r"name '(\w+)' is not defined": "the property {0} is not defined ({1})",
    "(maximum recursion depth)": "includes or calls itself without end",
    r"(.*: line \d+, column \d+)$": "is not valid XML: {0}",
}
_UNDEFINED = re.compile(r"the property (\S+) is not defined|unknown macro name: xacro:(\S+)")
# An include, or a definition of a name, in the old syntax of xacro.
_OLD = r"<(?:include\b[^>]*?\bfilename|(?:property|macro)\b[^>]*?=\s*[\"'][^\"'>]*\b{}\b)"
_LEVELS = 3  # folders above a package in which its sibling packages are looked for
_REMEDY = "on the robot, xacro FILE > robot.urdf writes a file that needs no other"


def read_description(
    path: Path, arguments: Mapping[str, str], trust: bool, skipped: list[str] | None
) -> str:
    """Return the URDF of a robot; a file that uses xacro is expanded.

    Args:
        path: URDF or xacro file.
        arguments: values of the arguments of the xacro file, keyed by name.
        trust: whether expressions of any kind are evaluated.
        skipped: receives the packages that are missing and left out; None to raise an error.

    Raises:
        ConfigurationError: the file cannot be read or expanded; the message has the reason.
    """
    try:
        text = read_text(path)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise refused(f"cannot read {path}: {reason}") from None
    if not any(macro in text for macro in ("xacro:", "$(", "${")) or "<sdf" in text:
        return text
    try:
        xacro = import_optional("xacro", "xacro")
    except ImportError:
        raise refused(
            f"{path} needs the package xacro: ./omni install xacro, or {_REMEDY}"
        ) from None
    # xacro warns of outdated functions and namespaces, which concern only the author of the file.
    with contextlib.ExitStack() as restored, contextlib.redirect_stderr(io.StringIO()):
        guarded = _guarded(xacro, packages_around(path), trust, skipped)
        for (module, name), function in guarded.items():
            restored.callback(setattr, module, name, getattr(module, name))
            setattr(module, name, function)
        return _expanded(xacro, path, arguments, skipped)


def _expanded(
    xacro: Any, path: Path, arguments: Mapping[str, str], skipped: list[str] | None
) -> str:
    try:
        document = xacro.process_file(str(path.resolve()), mappings=dict(arguments), verbosity=0)
        files = (path, *map(Path, xacro.all_includes))
        known = [
            name for file in files for names in _ARGUMENT.findall(_text(file)) for name in names
        ]
        if unknown := [name for name in arguments if name not in known]:
            hint = did_you_mean(unknown[0], filter(None, known))
            raise refused(f"{path} uses no argument {unknown[0]}{hint}")
        return str(document.toxml())
    except ConfigurationError:
        raise
    except Exception as error:  # xacro passes on every error of an evaluated expression
        problem = _reason(error)
        if found := re.fullmatch(r"the argument (\S+) has no value", problem):
            values = xacro.substitution_args_context["arg"]
            names = _ARGUMENT.findall(_text(Path((xacro.filestack or [path])[-1])))
            used = [found[1], *(name for one in names for name in one[1:] if name)]
            lacking = dict.fromkeys(f"{name}:=VALUE" for name in used if name not in values)
            problem += f"; give {' '.join(lacking)}"
        if found := _UNDEFINED.match(problem):
            old = re.compile(_OLD.format(re.escape(found[1] or found[2])))
            if any(old.search(_text(Path(file))) for file in (path, *xacro.all_includes)):
                problem += (
                    "; in the old syntax, which has no effect, tags lack the prefix xacro: write "
                    "<xacro:property, <xacro:macro, <xacro:include"
                )
        if skipped:
            problem += f", or is in a package that is left out: {', '.join(dict.fromkeys(skipped))}"
    place = Path((xacro.filestack or [path])[-1])
    raise refused(f"{place}: {problem}; {_REMEDY}") from None


def _reason(error: Exception) -> str:
    """Return what a file lacks, in words, from an error of xacro."""
    text = " ".join(str(error).split()) or type(error).__name__
    found = ((re.search(pattern, text), words) for pattern, words in _REASONS.items())
    return next((words.format(one[1], text) for one, words in found if one), text)


def _guarded(
    xacro: Any, packages: Mapping[str, Path], trust: bool, skipped: list[str] | None
) -> dict[tuple[Any, str], Any]:
    """Return functions with which xacro finds packages and evaluates only what `_check` permits.

    They are keyed by the module and the name of the functions that they replace.

    Args:
        xacro: the module.
        packages: folders of packages that no index contains, keyed by package.
        trust: whether all expressions are evaluated.
        skipped: receives the packages that are missing and left out; None to raise an error.
    """
    index = importlib.import_module("ament_index_python.packages")
    find, absolute = index.get_package_share_directory, xacro.abs_filename_spec
    include, call = xacro.get_include_files, xacro.handle_macro_call

    def find_around(package: str, *more: Any) -> str:
        if package in packages:
            return str(packages[package])
        try:
            return str(find(package, *more))
        except LookupError:
            if skipped is None:
                raise
            skipped.append(package)
            return f"{_ABSENT}/{package}"

    def include_what_exists(*words: Any) -> list[str]:
        return [name for name in include(*words) if not name.startswith(_ABSENT)]

    def call_what_exists(node: Any, *tables: Any) -> bool:
        try:
            return bool(call(node, *tables))
        except xacro.XacroException as error:
            if not skipped or not str(error).startswith("unknown macro name"):
                raise
            xacro.replace_node(node, by=None)
            return True

    return {
        (index, "get_package_share_directory"): find_around,
        (xacro, "abs_filename_spec"): lambda name: _in_package(absolute(name), packages.values()),
        (xacro, "get_include_files"): include_what_exists,
        (xacro, "handle_macro_call"): call_what_exists,
        **({} if trust else _checked(xacro)),
    }


def _checked(xacro: Any) -> dict[tuple[Any, str], Any]:
    """Return `safe_eval` and `eval_extension`, which evaluate all text, with a check before."""
    evaluate, extend = xacro.safe_eval, xacro.eval_extension

    def checked_evaluate(text: str, symbols: Any, *more: Any) -> Any:
        _check(text)
        for name in _REFLECTION:
            getattr(symbols, "root", symbols).get("python", {}).pop(name, None)
        return evaluate(text, symbols, *more)

    def checked_extend(text: str) -> Any:
        if text.startswith("$(eval "):
            _check(text[len("$(eval ") : -1])
        return extend(text)

    return {(xacro, "safe_eval"): checked_evaluate, (xacro, "eval_extension"): checked_extend}


def _in_package(name: str, packages: Iterable[Path]) -> str:
    """Return a file, also if the package installs its folder, such as bringup/config, as config."""
    path = Path(name)
    inside = [one for one in packages if path.is_relative_to(one)] if not path.exists() else []
    found = sorted(inside[0].rglob(str(path.relative_to(inside[0])))) if inside else []
    return str(found[0]) if found else name


def _check(expression: str) -> None:
    """Raise `ConfigurationError` if an expression could reach the interpreter."""
    try:
        nodes = list(ast.walk(ast.parse(expression.strip(), mode="eval")))
    except (SyntaxError, ValueError, RecursionError):
        return  # evaluating it fails
    names = [node.attr for node in nodes if isinstance(node, ast.Attribute)]
    names += [node.id for node in nodes if isinstance(node, ast.Name) and node.id[:2] == "__"]
    for name in filter(_SPECIAL.match, names):
        raise refused(
            f"the expression ${{{expression}}} uses {name}, through which it could run any "
            "program; if you trust the file, repeat the command with --trust"
        )


def packages_around(path: Path) -> dict[str, Path]:
    """Return the folders of the packages around a file, keyed by package; the nearest ones count.

    A folder without ``package.xml`` is a package if a file next to `path` asks for its name,
    because files are often copied without it.
    """
    found: dict[str, Path] = {}
    parents = [one for one in path.resolve().parents if one not in (Path.home(), Path("/"))]
    own = next((row for row, one in enumerate(parents) if (one / "package.xml").exists()), 0)
    for folder in parents[: own + _LEVELS + 1]:
        for depth in range(_LEVELS + 1):
            # Unlike that of a Path, this `glob` skips folders that disappear meanwhile.
            for manifest in sorted(glob.glob("*/" * depth + "package.xml", root_dir=folder)):
                if name := re.search(r"<name>\s*([\w-]+)\s*</name>", _text(folder / manifest)):
                    found.setdefault(name[1], (folder / manifest).parent)
    texts = (_text(one) for one in (path, *sorted(path.parent.glob("*.xacro"))))
    wanted = {name for text in texts for names in _FIND.findall(text) for name in names if name}
    for folder in parents:
        for package in wanted:
            for place in (folder, folder / package):
                if place.name == package and place.is_dir():
                    found.setdefault(package, place)
    return found


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
