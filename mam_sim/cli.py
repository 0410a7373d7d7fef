"""The command line: a table of verbs; each is a dataclass of options with a `run`."""

from __future__ import annotations

import importlib
import io
import os
import sys
from typing import TYPE_CHECKING

from mam_sim import lean

if TYPE_CHECKING:
    from mam_pipeline.errors import MamSimError
    from mam_sim.options import Verb

VERBS: dict[str, tuple[str, str]] = {
    "make-env": ("mam_sim.verbs.make_env:MakeEnv", "photo | mesh | URDF to a robot environment"),
    "articulate": ("mam_sim.verbs.articulate:Articulate", "mesh or photo to an asset folder"),
    "batch": ("mam_sim.verbs.batch:Batch", "assets of many inputs, resumable, side by side"),
    "check": ("mam_sim.verbs.check:Check", "lint and physical executability of an asset or URDF"),
    "mend": ("mam_sim.verbs.mend:Mend", "repair what check finds in anybody's URDF, MJCF or USD"),
    "bench": ("mam_sim_bench.bench:Bench", "score the engine on a folder of ground-truth URDFs"),
    "generate": ("mam_sim.verbs.generate:Generate", "procedural articulated objects with truth"),
    "collect": ("mam_sim.verbs.collect:Collect", "demonstrations by the scripted expert"),
    "train": ("mam_sim.verbs.train:Train", "a policy by imitation or reinforcement learning"),
    "eval": ("mam_sim.verbs.evaluate:Evaluate", "task success of a policy, with intervals"),
    "register": ("mam_sim.verbs.register:Register", "an environment id for an asset, or for some"),
    "rank": ("mam_sim.verbs.rank:Rank", "does a robot succeed on assets, ours or anybody's URDF"),
    "export": ("mam_sim.verbs.export:Export", "dataset or policy to LeRobot, asset to MJCF or USD"),
    "calibrate": (
        "mam_sim_arm.verbs.calibrate:Calibrate",
        "joints and camera of a real arm",
    ),
    "perceive": (
        "mam_sim_arm.verbs.perceive:Perceive",
        "object and handle by a real camera",
    ),
    "deploy": ("mam_sim_arm.verbs.deploy:Deploy", "a policy on a calibrated arm, inside limits"),
    "park": ("mam_sim_arm.verbs.park:Park", "an arm that holds somewhere comes to rest"),
    "view": ("mam_sim.verbs.view:View", "pictures or a video of an asset moving its joints"),
    "studio": ("mam_sim.verbs.studio:Studio", "look at an object, and put right what is wrong"),
    "bench-photo": ("mam_sim_bench.bench_photo:BenchPhoto", "score the photo reconstructor"),
    "doctor": ("mam_sim.verbs.doctor:Doctor", "what is installed, what is active, and the fixes"),
}

PACKAGES = {"mam_sim_arm": "lerobot_robot_mam_sim", "mam_sim_bench": "mam_sim_bench"}
"""Packages of verbs (real arms, benchmarks), each with the folder of plugins/ that installs it."""


def main(argv: list[str] | None = None) -> int:
    """Run one verb; returns the exit status (0 ok, 1 not physical, 2 input, 3 hint, 4 kind)."""
    args = list(sys.argv[1:] if argv is None else argv)
    if not args or args[0] in ("-h", "--help", "help"):
        print(_usage())
        return 0 if args else 2
    if args[0] in ("-V", "--version"):
        from mam_sim import __version__

        print(f"mam-sim {__version__}")
        return 0
    if argv is None:  # a process of our own
        from mam_sim.stopping import watch_over

        watch_over()
    if args[0] == "studio":  # OpenBLAS hangs where two threads of a page start its own at once
        os.environ["OPENBLAS_NUM_THREADS"] = "1"
    lean.install()
    for stream in (sys.stdout, sys.stderr):  # the name of a file need not be text
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    # imported here so that `mam-sim --help` stays instant
    from mam_pipeline.errors import MamSimError, disk_error, unknown_name
    from mam_sim.stopping import Stopped, stoppable

    try:
        with stoppable():
            if args[0] not in VERBS:
                raise unknown_name("verb", args[0], VERBS)
            from mam_sim.options import parse

            return parse(verb_class(args[0]), f"mam-sim {args[0]}", args[1:]).run()
    except MamSimError as error:
        return _refused(error)
    except BrokenPipeError:  # the reader of our output has gone, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:  # a full disk, a missing right, a name that cannot be
        return _refused(disk_error(error))
    except MemoryError:
        print("mam-sim: there is not enough memory for this; simplify the input", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("mam-sim: interrupted", file=sys.stderr)
        return 130
    except Stopped as stop:
        print("mam-sim: stopped", file=sys.stderr)
        return stop.status
    except SystemExit as stop:  # argument parsing
        return stop.code if isinstance(stop.code, int) else 2


def _refused(error: MamSimError) -> int:
    """Say what is wrong in its sentence; the traceback too where MAM_SIM_DEBUG is set."""
    if os.environ.get("MAM_SIM_DEBUG"):
        import traceback

        from mam_pipeline.secrets import masked

        print(masked("".join(traceback.format_exception(error))), file=sys.stderr)
    print(f"mam-sim: {error}", file=sys.stderr)
    return error.exit_code


def verb_class(verb: str) -> type[Verb]:
    """The dataclass of a verb's options.

    Raises:
        BackendError: the verb is of a package that is not installed.
    """
    module, _, name = VERBS[verb][0].partition(":")
    try:
        found: type[Verb] = getattr(importlib.import_module(module), name)
    except ModuleNotFoundError as error:
        folder = PACKAGES.get((error.name or "").partition(".")[0])
        if folder is None:
            raise
        from mam_pipeline.optional import not_installed

        raise not_installed(f"mam-sim {verb}", folder) from error
    return found


def _usage() -> str:
    width = max(map(len, VERBS))
    lines = [
        "usage: mam-sim VERB [ARGUMENTS]   (VERB --help tells more, --help-all everything)",
        "",
    ]
    lines += [f"  {verb:<{width}}  {text}" for verb, (_, text) in VERBS.items()]
    return "\n".join(lines)


if __name__ == "__main__":
    raise SystemExit(main())
