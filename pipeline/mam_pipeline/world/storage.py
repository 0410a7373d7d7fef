"""Storage furniture."""
from mam_pipeline.world.kit import Builder


def cabinet(b: Builder) -> None:
    w, d, h = b.uniform(0.4, 1.2), b.uniform(0.3, 0.6), b.uniform(0.5, 1.8)
    b.size(w, d, h)
    t = 0.02
    b.shell("base", (0, 0, 0), (d, w, h), t, "-x")
    link = b.link("door_0", "door")
    b.front(link, (-t, 0, 0), (0, w, h), b.choice(["slab", "framed", "glass", "louvre", "moulded", "double"]))
    b.handle(link, (-t, w - 0.06, h / 2), (-1, 0, 0), (0, 0, 1), 0.15, b.choice(["bar", "bow", "knob", "double", "recessed", "cup", "strip", "ring"]))
    b.hinge(link, "base", (-t, 0, 0), (0, 0, 1), 0, 1.8, opens=(-1, 0, 0))
    b.rotary("base", (0.1, w, h / 2), (0, 1, 0), 0.03, 0.03)
    b.button("base", (0.2, w, h / 2), (0, 1, 0), 0.03, 0.02)
    k = b.link("wheel", "wheel")
    b.wheel(k, (0.2, -0.05, 0.1), (0, 1, 0), 0.1, 0.04)
    b.spin(k, "base", (0.2, -0.05, 0.1), (0, 1, 0))


CATEGORIES = {"cabinet": cabinet}
