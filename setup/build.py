"""The build: packages by colcon, and kernels compiled again exactly where that is needed."""

from __future__ import annotations

import ast
import contextlib
import hashlib
import itertools
import os
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from setup.failures import SetupError
from setup.pythons import say
from setup.steps import Steps
from setup.workspace import (
    Workspace,
    build_identity,
    file_digest,
    final_environment,
    processor,
    read_stamp,
    source_state,
    venv_environment,
    write_stamp,
)


def build(workspace: Workspace, steps: Steps) -> str:
    """Build the packages from scratch and compile the kernels; return the kernels' folder."""
    state = source_state(workspace.root)  # taken first: an edit meanwhile builds again
    environment_stamp = read_stamp(workspace.venv)
    libraries = environment_stamp["libraries"]
    environment = venv_environment(workspace, libraries)
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    packages = sorted(path.parent for path in (workspace.root / "src").glob("*/package.xml"))
    steps.stage(f"building {len(packages)} packages with colcon")
    # From nothing, so that no file of a deleted module stays; the stamp goes first.
    (workspace.install / "omni.json").unlink(missing_ok=True)
    before = module_stamps(workspace.libraries)
    for folder in (workspace.root / "build", workspace.install, workspace.cache / "colcon"):
        remove(folder)

    def note(line: str) -> str | None:
        return line if line.startswith(("Starting >>>", "Finished <<<")) else None

    colcon: list[object] = [workspace.python, workspace.venv / "bin" / "colcon"]
    colcon += ["--log-base", workspace.cache / "colcon", "build"]
    colcon += ["--base-paths", "src", "--event-handlers", "console_cohesion+"]
    code, output = steps.run(colcon, environment, note)
    if code:
        failed = re.findall(r"(?m)^Failed\s+<<<\s+(\S+)", output)
        raise SetupError(
            "building {} failed: see {} for the cause.".format(
                ", ".join(failed) or "the packages", workspace.log
            )
        )
    for package in packages:
        prefix = workspace.install / package.name
        if not (prefix / "share" / package.name / "hook" / "ament_prefix_path.dsv").exists():
            raise SetupError(
                f"colcon has not taken {package} for an ament_python package: mend its package.xml "
                f"(details in {workspace.log})."
            )
        mend_first_lines(prefix / "lib")
    kernels = compile_kernels(workspace, steps, libraries, before)
    identity = build_identity(environment_stamp)
    write_stamp(workspace.install, identity, state=state, kernels=kernels)
    return kernels


def compile_kernels(
    workspace: Workspace, steps: Steps, libraries: Sequence[str], before: Mapping[Path, str]
) -> str:
    """Compile all kernels into their cache; return the name of its folder.

    Args:
        workspace: which has been built.
        steps: which run the compiler.
        libraries: of the environment.
        before: stamps of the modules that the kernels in the cache have been compiled from.
    """
    folder = workspace.cache / "numba"
    stamp_modules(workspace.root, workspace.libraries)
    # The stamps have made colcon's bytecode stale, and who may not write any would do without.
    compiling = ["-m", "compileall", "-q", "-j", "0", *workspace.libraries]
    steps.run([workspace.python, *compiling], venv_environment(workspace, libraries))
    forget_kernels(folder, before, module_stamps(workspace.libraries))
    more = [file_digest(workspace.lock_file), processor(), os.path.realpath(workspace.python)]
    kernels = hashlib.sha256("\n".join(more).encode()).hexdigest()[:16]
    (folder / kernels).mkdir(parents=True, exist_ok=True)
    (folder / kernels).touch()
    for old in sorted(folder.iterdir(), key=os.path.getmtime)[:-2]:
        remove(old)
    if (workspace.root / "src/omni_bringup/omni_bringup/warm_up.py").exists():
        steps.stage("compiling the kernels")
        environment = final_environment(workspace, libraries, kernels)
        warm_up = [workspace.python, "-m", "omni_bringup.warm_up"]
        code, output = steps.run(warm_up, environment, lambda line: line)
        if code:
            # The command that needs the kernel will say more about it than this step can.
            say(
                "the kernels could not all be compiled beforehand ({}); going on, details in "
                "{}".format((output.splitlines() or ["no output"])[-1], workspace.log)
            )
    return kernels


def module_digests(root: Path) -> dict[str, str]:
    """Return a digest of each module and of everything that it imports, directly or not.

    numba's cache keeps a kernel until its own file changes, and does not see that a function called
    from another module has; `stamp_modules` writes these digests into the files.
    """
    modules = {}
    for folder in sorted((root / "src").glob("*")):
        for path in sorted((folder / folder.name).rglob("*.py")):
            parts = path.relative_to(folder).with_suffix("").parts
            modules[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    texts = {name: path.read_bytes() for name, path in modules.items()}
    uses = {}
    for name, text in texts.items():
        folder_of = modules[name].name == "__init__.py"
        uses[name] = set(imported_modules(text, name if folder_of else name.rpartition(".")[0]))
        uses[name].add(name.rpartition(".")[0])
        if folder_of and b"iter_modules" in text:  # plug-ins, imported by the names of their files
            uses[name] |= {other for other in texts if other.rpartition(".")[0] == name}
    digests = {}
    for name in texts:
        pending: list[str] = [name]
        reached: set[str] = set()
        while pending:
            other = pending.pop()
            if other in texts and other not in reached:
                reached.add(other)
                pending += uses[other]
        digest = hashlib.sha256()
        for other in sorted(reached):
            digest.update(other.encode() + b"\0" + texts[other] + b"\0")
        digests[name] = digest.hexdigest()
    return digests


def stamp_modules(root: Path, libraries: Sequence[Path]) -> None:
    """Write the digest of each module behind the text of its installed file.

    numba asks a file's own text whether its kernels are still good: they are thereby compiled
    again exactly when something that they use has changed.
    """
    digests = module_digests(root)
    for library, (name, digest) in itertools.product(libraries, digests.items()):
        path = library.joinpath(*name.split("."))
        path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        if path.exists():
            with path.open("a", encoding="utf-8") as file:
                file.write(f"\n# With all that it uses: {digest[:16]}\n")


def module_stamps(libraries: Sequence[Path]) -> dict[Path, str]:
    """Return the last line of each installed module, which `stamp_modules` has written."""
    modules = [path for library in libraries for path in library.glob("**/*.py")]
    return {path: path.read_text(encoding="utf-8").rpartition("\n#")[2] for path in modules}


def forget_kernels(folder: Path, before: Mapping[Path, str], now: Mapping[Path, str]) -> None:
    """Delete the kernels of modules that have changed.

    numba would find them out of date, but only after it has read them; and it cannot read one that
    was called with a class that is no more.
    """
    for path, stamp in before.items():
        if now.get(path) != stamp:
            for kernel in folder.glob(f"*/{path.parent.name}_*/{path.stem}.*"):
                kernel.unlink()


def imported_modules(text: bytes, package: str) -> Iterator[str]:
    """Yield the modules that a module's text may import, their parent packages included."""
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError):
        return  # the build or the command will say so
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = package.split(".")[: len(package.split(".")) + 1 - node.level]
            parent = ".".join((base if node.level else []) + ([node.module] if node.module else []))
            names = [parent] + [parent + "." + alias.name for alias in node.names]
        else:
            continue
        for name in names:
            parts = name.split(".")
            yield from (".".join(parts[: end + 1]) for end in range(len(parts)))


def remove(folder: Path) -> None:
    """Delete a folder and what is in it, if it is there."""
    with contextlib.suppress(FileNotFoundError):
        shutil.rmtree(str(folder))


def mend_first_lines(library: Path) -> None:
    """Give executables a first line that works when the path is long or contains spaces."""
    for script in library.glob("*/*"):
        if script.parent.name.startswith("python3") or not script.is_file():
            continue
        text = script.read_bytes()
        first, _, rest = text.partition(b"\n")
        # setuptools quotes a path with spaces, which no kernel understands.
        if first.startswith(b'#!"') or (first.startswith(b"#!/") and len(first) > 127):
            interpreter = first[2:].strip(b'"')
            # A string to Python, a command to the shell.
            script.write_bytes(
                b"#!/bin/sh\n'''exec' \"" + interpreter + b'" "$0" "$@"\n' + b"' '''\n" + rest
            )
