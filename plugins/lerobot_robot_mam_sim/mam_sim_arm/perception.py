"""Where the handle is and how far the joint has moved, from tags in a camera's picture.

A tag on the body gives the object's pose, one on the moving part the joint's value; the handle
follows from both by the twin. What the arm hides while it pulls is carried on with the hand.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from mam_envs.object_model import ObjectModel
from mam_pipeline.types import FloatArray
from mam_sim_arm.camera import CameraModel
from mam_sim_arm.targets import Marker, Picture, detect_tags

CORNER, LEVEL = 0.5, 0.01
"""Standard deviations: of a tag's corner, pixels; of the object's height, metres."""
EMPTY, SLIP = 0.03, 0.15
"""Shares of the gripper's range: less open holds nothing; opened by more has let go."""


@dataclass(frozen=True)
class Seen:
    """What is believed after a picture.

    Attributes:
        object_pose: (4, 4) base_T_asset.
        handle: (3,) base frame, metres. value: of the joint. Both None where nothing tells them.
        tags: corners (4, 2) of the tags that were found, pixels, by id.
        source: where the joint's value comes from: "tag", "hand" (the tag is hidden, and the hand
            holds the handle), or "unseen".
    """

    object_pose: FloatArray
    handle: FloatArray | None
    value: float | None
    tags: dict[int, FloatArray]
    source: str


class Perceiver:
    """Follows one joint of one object through the pictures of an episode."""

    def __init__(
        self, camera: CameraModel, markers: list[Marker], model: ObjectModel, joint: str,
        handle: FloatArray, level: float = 0.0, memory: int = 10,
    ) -> None:  # fmt: skip
        """Begin.

        Args:
            handle: (3,) point to grasp, asset frame at rest. level: height of the asset frame in
                the base frame as the object is meant to stand, metres. memory: pictures over
                which the object's pose is averaged.
        """
        self.level = level
        self.camera, self.markers, self.model, self.joint = camera, markers, model, joint
        self.handle, self.memory = np.asarray(handle, dtype=float), memory
        moving = set(model.moving_links(joint))
        self.on_part = [m for m in markers if m.link in moving]
        self.on_body = [m for m in markers if m.link not in moving]
        lower, upper = model.limits(model.card_joint(joint))
        self.limits = max(lower, -2 * np.pi), min(upper, 2 * np.pi)
        self.ways = np.asarray(np.linspace(*self.limits, 400), dtype=np.float64)
        self.motion = model.motion(joint, self.ways, {})
        self.path = self.motion[:, :3, :3] @ self.handle + self.motion[:, :3, 3]
        self.reset()

    def reset(self) -> None:
        """Forget the episode."""
        self.poses: list[FloatArray] = []
        self.last: Seen | None = None
        self.held: tuple[FloatArray, FloatArray] | None = None  # by the hand, at `width`
        self.width = 0.0

    def update(
        self, picture: Picture, tool: FloatArray | None = None, width: float | None = None
    ) -> Seen | None:
        """What is believed with this picture; None until the object has been seen.

        Args:
            tool: (4, 4) base_T_tool as the motors say; None where there is no hand to go by.
            width: how far the hand that holds something is open, 0 shut to 1; None where it holds
                nothing.
        """
        tags = detect_tags(picture)
        self._locate(tags)
        if not self.poses:
            return None
        pose = _mean(self.poses)
        values = [v for m in self.on_part if m.id in tags
                  for v in [self._value(pose, m, tags[m.id])] if v is not None]  # fmt: skip
        value: float | None = None
        handle: FloatArray | None = None
        source = "unseen"
        if values:
            value, source = float(np.clip(np.median(values), *self.limits)), "tag"
        elif self.held is not None and tool is not None and self._holds(width):
            value, source = self._carried(pose, tool), "hand"
        if value is not None:
            motion = self.model.motion(self.joint, np.array([value]), {})[0]
            at = motion[:3, :3] @ self.handle + motion[:3, 3]
            handle = pose[:3, :3] @ at + pose[:3, 3]
        if source == "tag" and handle is not None:
            self.held = None
            if tool is not None and width is not None:
                near = np.linalg.norm(tool[:3, 3] - handle) < 0.05
                self.held, self.width = (tool, handle) if near else None, width
        elif source == "unseen":
            self.held = None  # what the hand has lost it does not get back unseen
        self.last = Seen(pose, handle, value, tags, source)
        return self.last

    def _holds(self, width: float | None) -> bool:
        """Whether the hand still holds what it held: it is neither shut nor wider than then."""
        return width is not None and EMPTY < width < self.width + SLIP

    def overlay(self, picture: Picture) -> Picture:
        """(H, W, 3) the picture with the tags found, the handle, its way, and the joint's value."""
        out = np.ascontiguousarray(picture).copy()
        seen = self.last
        if seen is None:
            cv2.putText(out, "no tag of the body seen", (12, 28), 0, 0.8, (255, 40, 40), 2)
            return out
        for corners in seen.tags.values():
            cv2.polylines(out, [corners.round().astype(np.int32)], True, (40, 200, 40), 2)
        way = self.path @ seen.object_pose[:3, :3].T + seen.object_pose[:3, 3]
        line = self.camera.project(way).round().astype(np.int32)
        cv2.polylines(out, [line], False, (60, 120, 255), 2)
        words = f"{self.joint}: its tag is not seen"
        if seen.handle is not None:
            x, y = self.camera.project(seen.handle[None])[0].round().astype(int).tolist()
            cv2.circle(out, (x, y), 9, (255, 60, 60), 2)
            words = f"{self.joint} {seen.value:.3f} by {seen.source}"
        cv2.putText(out, words, (12, 28), 0, 0.8, (255, 40, 40), 2)
        return out

    def _locate(self, tags: dict[int, FloatArray]) -> None:
        """Put the object's pose into the memory: where all tags together fit best, upright.

        The tags' distance from each other tells depth better than a small tag's size does.
        """
        first = next((m for m in self.on_body if m.id in tags), None)
        found = None if first is None else self._pose_of(first, tags[first.id])
        if first is None or found is None:
            return
        start = _upright(found @ np.linalg.inv(first.pose), first, found)
        seen = [m for m in self.markers if m.id in tags]
        pixels = np.concatenate([tags[m.id] for m in seen])
        on_part = [m for m in self.on_part if m.id in tags]
        value = self._value(start, on_part[0], tags[on_part[0].id]) if on_part else None
        moving = value is not None

        def errors(x: FloatArray) -> FloatArray:
            pose = _standing(x)
            rows = []
            for marker in seen:
                place = pose @ marker.pose
                if moving and marker in on_part:
                    place = pose @ self._motion(float(x[4])) @ marker.pose
                rows.append(marker.corners @ place[:3, :3].T + place[:3, 3])
            off = (self.camera.project(np.concatenate(rows)) - pixels).reshape(-1)
            return np.append(off / CORNER, (x[2] - self.level) / LEVEL)

        if not moving and on_part:
            seen = [m for m in seen if m not in on_part]
            pixels = np.concatenate([tags[m.id] for m in seen])
        yaw = np.arctan2(start[1, 0], start[0, 0])
        begin = np.array([*start[:3, 3], yaw, *([value] if moving else [])], dtype=float)
        self.poses.append(_standing(least_squares(errors, begin, max_nfev=12).x))
        self.poses = self.poses[-self.memory :]

    def _motion(self, value: float) -> FloatArray:
        """(4, 4) what the joint's value does to its part, between two that are known."""
        at = np.clip((value - self.ways[0]) / (self.ways[1] - self.ways[0]), 0, len(self.ways) - 1)
        low = min(int(at), len(self.ways) - 2)
        share = at - low
        return np.asarray((1 - share) * self.motion[low] + share * self.motion[low + 1])

    def _pose_of(self, marker: Marker, corners: FloatArray) -> FloatArray | None:
        """(4, 4) base_T_marker of one tag."""
        ok, turn, shift = cv2.solvePnP(
            marker.corners, corners, self.camera.matrix, self.camera.distortion,
            flags=cv2.SOLVEPNP_IPPE,
        )  # fmt: skip
        if not ok:
            return None
        inside = np.eye(4)
        inside[:3, :3], inside[:3, 3] = cv2.Rodrigues(turn)[0], shift.reshape(3)
        return np.asarray(self.camera.pose @ inside)

    def _value(self, pose: FloatArray, marker: Marker, corners: FloatArray) -> float | None:
        """The joint's value at which a tag of the part would be where it is seen."""
        inside = np.linalg.inv(self.camera.pose) @ pose
        motion = self.motion
        points = marker.corners @ marker.pose[:3, :3].T + marker.pose[:3, 3]
        moved = np.einsum("nij,kj->nki", motion[:, :3, :3], points) + motion[:, None, :3, 3]
        seen, _ = cv2.projectPoints(
            moved.reshape(-1, 3), cv2.Rodrigues(inside[:3, :3])[0], inside[:3, 3],
            self.camera.matrix, self.camera.distortion,
        )  # fmt: skip
        off = np.linalg.norm(seen.reshape(len(moved), 4, 2) - corners, axis=2).mean(axis=1)
        best = int(off.argmin())
        if off[best] > 0.5 * np.linalg.norm(corners[0] - corners[2]):
            return None
        lo, hi = max(best - 1, 0), min(best + 1, len(off) - 1)
        if lo == best or hi == best:
            return float(self.ways[best])
        a, b, c = off[[lo, best, hi]] ** 2
        bend = a - 2 * b + c
        shift = 0.0 if bend <= 0 else float(np.clip(0.5 * (a - c) / bend, -1, 1))
        return float(self.ways[best] + shift * (self.ways[1] - self.ways[0]))

    def _carried(self, pose: FloatArray, tool: FloatArray) -> float:
        """The joint's value where the hand, which held the handle, has carried it to."""
        assert self.held is not None
        before, handle = self.held
        local = np.linalg.inv(before) @ np.append(handle, 1.0)
        now = (np.linalg.inv(pose) @ tool @ local)[:3]
        return float(self.ways[np.linalg.norm(self.path - now, axis=1).argmin()])


def _upright(pose: FloatArray, marker: Marker, seen: FloatArray) -> FloatArray:
    """The object's pose (4, 4) without tilt, as it stands on the robot's ground: a small tag tells
    its place much better than its tilt, so the tag's middle stays where it is `seen`."""
    yaw = np.arctan2(pose[1, 0] - pose[0, 1], pose[0, 0] + pose[1, 1])
    out = np.eye(4)
    out[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    out[:3, 3] = seen[:3, 3] - out[:3, :3] @ marker.pose[:3, 3]
    return out


def _standing(x: FloatArray) -> FloatArray:
    """(4, 4) of a place and a yaw, (x, y, z, yaw ...)."""
    out = np.eye(4)
    c, s = np.cos(x[3]), np.sin(x[3])
    out[:2, :2], out[:3, 3] = [[c, -s], [s, c]], x[:3]
    return out


def _mean(poses: list[FloatArray]) -> FloatArray:
    """The middle of poses (4, 4): median of places, mean of rotations."""
    stack = np.stack(poses)
    out = np.eye(4)
    out[:3, :3] = Rotation.from_matrix(stack[:, :3, :3]).mean().as_matrix()
    out[:3, 3] = np.median(stack[:, :3, 3], axis=0)
    return out
