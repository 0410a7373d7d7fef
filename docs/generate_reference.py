"""Reference pages made from the code: every flag of the command line, every key of a file.

mkdocs calls this while it builds the site (docs/hooks.py); `python docs/generate_reference.py cli`
or `config` prints a page. Both come from the parsers that `mam-sim` itself uses.
"""

from __future__ import annotations

import html
import inspect
import re
import sys
import warnings
from collections.abc import Iterator, Sequence
from typing import Any

from mam_sim.cli import VERBS, verb_class
from mam_sim.flags import REGISTRY
from mam_sim.options import Verb, defaults

SECTIONS = {
    "pipeline": ("make-env", "What decides an asset; read by `make-env` and `articulate`."),
    "env": ("make-env", "The environment; read by `make-env`, `collect` and `train`."),
    "collect": ("collect", "Demonstrations of the expert; read by `collect`."),
    "bench": ("bench", "The benchmark of the engine; read by `bench`."),
}
"""Section of a file -> the verb whose parser describes it, and a sentence."""


def cli() -> str:
    """Every verb with its flags, as Markdown."""
    out = []
    for verb, (_, summary) in VERBS.items():
        base = verb_class(verb).start((), {})
        parser = parser_of(base)
        places = [a for g in parser._action_groups for a in g._group_actions if _positional(a)]
        words = " ".join(_place(a) for a in places)
        out += [f"## {verb}", "", f"*{summary[0].upper()}{summary[1:]}.*", ""]
        out += ["```", f"mam-sim {verb} {words} [OPTIONS]".replace("  ", " "), "```", ""]
        out += [inspect.cleandoc(type(base).__doc__ or ""), ""]
        out += _table(("flag", "value", "meaning"), _flags(parser))
        for group in parser._action_groups:
            title, rows = str(group.title), list(_rows(group._group_actions))
            if not rows or title in ("options", "positional arguments"):
                continue
            section = title.removesuffix(" options")
            deep = section.partition(".")[0] in SECTIONS and section.count(".") > 1
            if section.split(".")[0] == "env" or deep:
                continue
            out += ["", f"Section `{section}`:", ""]
            out += _table(("flag", "value", "meaning"), rows)
        if any(str(g.title).startswith("env.") for g in parser._action_groups):
            out += ["", "All keys of the [section `env`](config.md#env), as `--env.KEY VALUE`."]
        out.append("")
    return "\n".join(out)


def config() -> str:
    """Every key of a configuration file, as Markdown."""
    out = []
    for section, (verb, sentence) in SECTIONS.items():
        out += [f"## {section}", "", sentence, ""]
        parser = parser_of(verb_class(verb).start((), {}))
        for group in parser._action_groups:
            name = str(group.title).removesuffix(" options")
            if name.partition(".")[0] == section:
                out += _keys(name, str(group.description or ""), group._group_actions)
    out += ["## train", "", "Settings of an algorithm; read by `train`, which has one `algo`.", ""]
    from mam_policies.algorithms import ALGORITHMS
    from mam_sim.verbs.train import Train

    for algo in ALGORITHMS.builtin:
        parser = parser_of(defaults(Train.with_algorithm(algo)))
        for group in parser._action_groups:
            if str(group.title) == "train options":
                out += _keys(f"train, algo: {algo}", str(group.description or ""),
                             group._group_actions)  # fmt: skip
    return "\n".join(out)


def parser_of(base: Verb) -> Any:
    """The parser of a verb with these defaults, as tyro builds it."""
    import tyro

    with warnings.catch_warnings():  # there is no other way to the parser yet
        warnings.simplefilter("ignore", DeprecationWarning)
        return tyro.extras.get_parser(type(base), default=base, registry=REGISTRY)


def _flags(parser: Any) -> list[tuple[str, str, str]]:
    """Rows of the verb's own arguments, those without a flag first."""
    groups = {str(g.title): list(_rows(g._group_actions)) for g in parser._action_groups}
    return groups.get("positional arguments", []) + groups.get("options", [])


def _positional(action: Any) -> bool:
    return not action.option_strings


def _place(action: Any) -> str:
    """A positional argument as a usage line names it."""
    return str(action.dest).upper() + (" ..." if action.nargs == "*" else "")


def _keys(name: str, description: str, actions: Sequence[Any]) -> list[str]:
    rows = []
    for action in actions:
        meaning, default = _split(action.help)
        key = str(action.dest).rpartition(".")[2].replace("-", "_")
        rows.append((f"`{key}`", default, meaning))
    text = " ".join(description.split())
    return [f"### {name}", "", text, "", *_table(("key", "default", "meaning"), rows), ""]


def _rows(actions: Sequence[Any]) -> Iterator[tuple[str, str, str]]:
    """(flag, value, meaning) of every action but --help."""
    for action in actions:
        if "--help" in action.option_strings:
            continue
        meaning, default = _split(action.help)
        flag = ", ".join(f"`{o}`" for o in action.option_strings) or f"`{_place(action)}`"
        value = "" if action.nargs == 0 or _positional(action) else _value(str(action.metavar))
        yield flag, value, f"{meaning} Default: {default}." if default else meaning


def _value(metavar: str) -> str:
    text = metavar.replace("{None}|", "")
    return f"`{text}`".replace("|", "\\|")


def _split(text: str | None) -> tuple[str, str]:
    """The sentence of a flag, and its default as code; "" where there is none."""
    text = text or ""
    found = re.search(r"\(default: (.*)\)$", text, re.DOTALL)
    default = found[1].strip() if found else ""
    meaning = re.sub(r"\s*\((default: .*|required)\)$", "", text, flags=re.DOTALL).strip()
    shown = "" if default in ("", "None") else f"`{default}`".replace("|", "\\|")
    return _cell(meaning[:1].upper() + meaning[1:]), shown


def _cell(text: str) -> str:
    return html.escape(" ".join(text.split()), quote=False).replace("|", "\\|")


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [
        f"| {' | '.join(heads)} |",
        "|" + "---|" * len(heads),
        *(f"| {' | '.join(row)} |" for row in rows),
    ]


if __name__ == "__main__":
    print({"cli": cli, "config": config}[sys.argv[1]]())
