"""Repairs of names and of the tree of links and joints."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections import defaultdict

from mam_pipeline.check.profiles import is_identifier
from mam_pipeline.mend.work import Work, attribute, child

NAMED = {"link": ("link", "link1", "link2"), "joint": ("joint", "joint1", "joint2")}
"""Attributes by which links and joints are named elsewhere."""


def tree(work: Work, reason: str = "bad_tree") -> None:
    """One name each, no end that leads to nothing, one root."""
    for tag in ("link", "joint"):
        _same_name(work, tag)
    _lost_ends(work)
    _roots(work)


def _same_name(work: Work, tag: str) -> None:
    """Give those without a name, and the second of two, a name of their own.

    Of several links of one name and as many joints that hold them, the first belongs to the first.
    """
    elements = work.root.findall(tag)
    taken = {str(e.get("name")) for e in elements if e.get("name")}
    groups: dict[str, list[ET.Element]] = defaultdict(list)
    for element in elements:
        groups[element.get("name") or ""].append(element)
    for name, group in groups.items():
        first = 0 if not name else 1
        holders = [j.find("child") for j in work.root.findall("joint")
                   if tag == "link" and attribute(j, "child", "link") == name]  # fmt: skip
        for k, element in enumerate(group[first:], start=first):
            if name and ET.tostring(element).strip() == ET.tostring(group[0]).strip():
                work.root.remove(element)
                what = "its first and second are the same, word for word"
                work.change("bad_tree", f"{tag} {name}", "twice", "once", what)
                continue
            new = _free(name or tag, taken)
            element.set("name", new)
            holder = holders[k] if len(holders) == len(group) else None
            if holder is not None and k > 0:
                holder.set("link", new)
            why = "names are unique" if name else "everything has a name"
            work.change("bad_tree", f"{tag} {name}".strip(), name or "no name", new, why)


def _free(name: str, taken: set[str]) -> str:
    new, k = name, 1
    while new in taken:
        k += 1
        new = f"{name}_{k}"
    taken.add(new)
    return new


def _lost_ends(work: Work) -> None:
    """A joint's end that no link has: the link that is spelled alike, or an empty one."""
    alike = {n.strip().casefold(): n for n in work.links}
    for name, joint in work.joints.items():
        for end in ("parent", "child"):
            told = attribute(joint, end, "link")
            if told in work.links:
                continue
            found = alike.get(told.strip().casefold())
            if found is None and told and end == "parent":
                work.root.insert(0, ET.Element("link", name=told))
                why = "its joints hang on a link that was not there; an empty one moves nothing"
                work.change("bad_tree", f"link {told}", "missing", "an empty link", why)
            elif found is not None:
                child(joint, end).set("link", found)
                work.change("bad_tree", f"{name}, {end}", told, found, "no other link is meant")


def _roots(work: Work) -> None:
    """Every root but the largest hangs on it by a fixed joint, where it stands already."""
    held = {attribute(j, "child", "link") for j in work.joints.values()}
    roots = [n for n in work.links if n not in held]
    if len(roots) < 2:
        return
    weight = {n: sum(attribute(j, "parent", "link") == n for j in work.joints.values())
              for n in roots}  # fmt: skip
    first, taken = max(roots, key=lambda n: weight[n]), set(work.joints)
    for name in roots:
        if name == first:
            continue
        joint = ET.SubElement(work.root, "joint", name=_free(f"{name}_fixed", taken), type="fixed")
        ET.SubElement(joint, "parent", link=first)
        ET.SubElement(joint, "child", link=name)
        why = "a robot is one tree; the roots stand in one frame as they are"
        work.change("bad_tree", f"link {name}", "a second root", f"fixed to {first}", why)


def identifiers(work: Work, reason: str = "name_invalid") -> None:
    """Names of letters, digits and _, wherever they are named."""
    for tag, keys in NAMED.items():
        elements = [e for e in work.root.findall(tag) if e.get("name")]
        taken = {str(e.get("name")) for e in elements}
        for element in elements:
            old = str(element.get("name"))
            if is_identifier(old):
                continue
            base = re.sub(r"\W", "_", old, flags=re.ASCII)
            new = _free(base if is_identifier(base) else f"{tag}_{base}", taken)
            element.set("name", new)
            for other in work.root.iter():
                for key in keys:
                    if other.get(key) == old:
                        other.set(key, new)
                if other.tag == tag and other.get("name") == old:  # <joint> of a transmission
                    other.set("name", new)
            work.change("name_invalid", tag, old, new, "letters, digits and _ are taken by all")
