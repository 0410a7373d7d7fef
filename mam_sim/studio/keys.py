"""The keys of the studio: what each does, shown by `?`, and found by name with Ctrl+K."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from html import escape
from typing import Any

from mam_sim.studio.mend import Mend
from mam_sim.studio.parts import Parts, key_of
from mam_sim.studio.session import SHOWN
from mam_sim.studio.workspace import Workspace

BUTTON = '<button data-key="{key}" title="{title}"{off}>{label}</button>'
WIDTHS = {"small window": 320, "large window": 450}  # pixels of the panel
VIEW = (
    ("Drag", "Turn the view; with the right button, move it; the wheel goes closer"),
    ("Click", "Select a piece and choose its part; with <kbd>Shift</kbd>, one more"),
    ("<kbd>Shift</kbd> drag", "Select what lies in a box"),
    ("<kbd>1</kbd> – <kbd>9</kbd>", "Choose a part of the tree"),
)


class Keys:
    """Registers the keys, and makes the buttons for those that are needed most."""

    def __init__(self, work: Workspace, parts: Parts, mend: Mend) -> None:
        """Register all keys that do not depend on the object."""
        self.work, self.parts, self.mend = work, parts, mend
        self._gui: Any = work.server.gui
        self._help: Any = None
        self._rows: list[tuple[Any, Any]] = []  # for each row of the tree: choose it, wake it
        self._told = [*VIEW]
        on = self._on
        on("Play: open and close the chosen part, or all", "space", parts.play, alone=False)
        on("Type: hinge, spin, slide", "T", mend.next_motion)
        on("Flip: open it the other way", "F", mend.flip)
        on("Axis from front to back; again: the next such line", "X", lambda: mend.turn_to(0))
        on("Axis from left to right", "Y", lambda: mend.turn_to(1))
        on("Axis upright", "Z", lambda: mend.turn_to(2))
        on("Axis from the mesh: point at an edge or a round rim", "E", mend.point)
        on("Add a part of what is selected", "A", mend.make)
        on("Remove the chosen part: it does not move", "R", mend.still)
        on("Wake the chosen dormant part", "W", lambda: mend.awake(work.part))
        on("Undo", "Z", self._undo, "cmd/ctrl")
        on("Redo", "Z", self._redo, "cmd/ctrl+shift")
        on("Save", "S", self._save)
        on("Cancel, or end pointing; else choose nothing", "escape", self._leave, alone=False)
        on("Show the keys", "?", self._show, alone=False)
        for k in range(1, SHOWN + 1):
            self._command(f"Take line {k} of the chosen part", f"way {k}",
                          work.guarded(partial(mend.take_line, k)))  # fmt: skip
        for window, width in WIDTHS.items():
            self._command(f"Panel for a {window}", window, partial(_widen, width))

    def refresh(self) -> None:
        """Keys for the rows of the tree."""
        for number, row in enumerate(self.parts.rows):
            if number == len(self._rows):
                self._rows.append(self._row(number))
            called = self.work.called(row.name)
            for command, verb, off in zip(
                self._rows[number], ("Choose", "Wake"), (False, row.link >= 0)
            ):
                command.label, command.disabled = f"{verb} {called}", off
        for commands in self._rows[len(self.parts.rows) :]:
            for command in commands:
                command.disabled = True

    def buttons(self) -> str:
        """Buttons for the head of the page; those that cannot act are grey and say why."""
        session, play = self.work.open, self.parts.all is not None
        rows = (
            ("Undo", "ctrl+z", session.can_undo, "nothing to undo"),
            ("Redo", "ctrl+shift+z", session.can_redo, "nothing was undone"),
            ("Save", "s", session.unsaved, "nothing has been changed"),
            ("Play", "space", play, "nothing moves"),
            ("Keys", "?", True, ""),
        )
        return "".join(
            BUTTON.format(key=key, label=label, off="" if can else " disabled",
                          title=escape(key if can else why))
            for label, key, can, why in rows
        )  # fmt: skip

    def _on(
        self, label: str, key: str, act: Callable[..., Any], modifier: str | None = None,
        alone: bool = True,
    ) -> None:  # fmt: skip
        self._command(label, key, self.work.guarded(act, alone), modifier)
        held = f"{modifier.replace('cmd/', '').title()}+" if modifier else ""
        self._told.append((f"<kbd>{held}{key.replace('escape', 'Esc')}</kbd>", escape(label)))

    def _command(
        self, label: str, key: str, act: Callable[[Any], None], modifier: str | None = None
    ) -> Any:
        """Viser passes on any name of a key, also one that only a click of the page presses."""
        command = self._gui.add_command(label, hotkey=key, modifier=modifier)
        command.on_trigger(act)
        return command

    def _row(self, number: int) -> tuple[Any, Any]:
        """Commands of a row: to choose it and to wake it."""
        made = []
        for key, act in ((key_of(number), self._choose), (f"wake {number}", self._wake)):
            made.append(self._command("", key, self.work.guarded(partial(act, number))))
        return made[0], made[1]

    def _choose(self, number: int) -> None:
        self.work.select_nothing()
        self.work.choose(self.parts.rows[number].name)

    def _wake(self, number: int) -> None:
        self.mend.awake(self.parts.rows[number].name)

    def _undo(self) -> None:
        self._step(self.work.open.undo)

    def _redo(self) -> None:
        self._step(self.work.open.redo)

    def _step(self, step: Callable[[], Any]) -> None:
        session = self.work.open
        ground = session.state.ground
        step()
        self.work.after_edit()
        if session.state.ground is not ground:
            self.work.look_at_the_front()

    def _save(self, event: Any) -> None:
        path = self.work.open.save()
        self.work.say(event, "Saved", f"{path}", "green")
        self.work.after_edit()

    def _leave(self) -> None:
        if self._help is None:
            self.work.cancel()
        else:
            self._close()

    def _close(self) -> None:
        shown, self._help = self._help, None
        shown.close()

    def _show(self, event: Any) -> None:
        """A window with all keys; asked again, it goes."""
        if self._help is not None:
            self._close()
            return
        gui = self._gui if event.client is None else event.client.gui
        self._help = gui.add_modal("Keys")
        rows = "".join(f"<tr><td>{key}</td><td>{what}</td></tr>" for key, what in self._told)
        with self._help:
            gui.add_html(f'<table class="keys">{rows}</table>')
            gui.add_markdown("*Ctrl+K finds every action by its name.*")
            gui.add_button("Close (Esc)", color="gray").on_click(lambda _event: self._close())


def _widen(width: int, event: Any) -> None:
    event.client.gui.main_panel.set_width(width)
