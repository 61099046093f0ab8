"""Swings a pendulum that the visitors of /view control, until one of them clicks "Stop".

python examples/control_panel.py [tcpq://127.0.0.1:7700]
"""

import math
import sys
import threading
import time

from scenegate import Box, Line, Sphere, TreeViewer

STEP = 1 / 60

with TreeViewer(sys.argv[1] if len(sys.argv) > 1 else None) as viewer:
    panel = viewer.controls["Pendulum"]
    length = panel.add_slider("Length", 0.2, 2, value=1, unit="m")
    damping = panel.add_number("Damping", 0.1, min=0, max=5, step=0.1, unit="1/s")
    planet = panel.add_dropdown("Planet", ["Earth", "Mars", "Moon"])
    color = panel.add_color("Colour", "tomato")
    push = panel.add_button("Push")
    stop = panel.add_button("Stop")
    plot = panel.add_plot("Angle", "angle", seconds=10, unit="rad")
    viewer["mount"].set(Box((0.1, 0.1, 0.1)), transform=(0, 0, 2.5))
    panel.add_gizmo("Mount", "mount")  # moves the pendulum, which is below this path

    def show(_: object = None) -> None:
        weight = Sphere(0.12, color=color.value, transform=(0, 0, -length.value))
        viewer["mount/pendulum"].set(Line([(0, 0, 0), (0, 0, -length.value)], line_width=3), weight)

    angle, speed = 0.8, 0.0
    stopped = threading.Event()

    def give_a_push() -> None:
        global speed
        speed += 1.5

    for control in (length, color):
        control.on_update(show)
    push.on_click(give_a_push)
    stop.on_click(stopped.set)
    show()
    samples = []
    try:
        while not stopped.wait(STEP):
            gravity = {"Earth": 9.81, "Mars": 3.72, "Moon": 1.62}[planet.value]
            speed -= (gravity / length.value * math.sin(angle) + damping.value * speed) * STEP
            angle += speed * STEP
            viewer.set_transforms(["mount/pendulum"], [[0, 0, 0, math.cos(angle / 2), 0, math.sin(angle / 2), 0]])
            samples.append((time.time(), angle))
            if len(samples) == 4:  # one message for several samples
                plot.add_samples(*zip(*samples, strict=True))
                samples.clear()
    except KeyboardInterrupt:
        pass
    viewer["mount"].delete()
