"""A robot in a process of its own runs a search over lines of JSON; its touches come late, twice, not at all or askew.

Run: python examples/06_drive_a_robot.py   (8 s of processor time)

The program plays the robot: it presses simulated objects and knows nothing of beliefs. What it talks to is
``activetouch live``, in a second process, which is killed in the middle of the search and started again.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from activetouch import TactileSensor, TouchWorld

sensor, rng = TactileSensor.shipped("coarse"), np.random.default_rng(4)
objects = ["cube", "sphere", "cone", "cylinder"]
world = TouchWorld.sample(sensor, objects, rng)
log = Path(tempfile.mkdtemp()) / "today.jsonl"
COMMAND = [sys.executable, "-m", "activetouch", "live", "--sensor", "coarse", "--target", "cone", "--log", str(log)]


def start():
    """The process that decides, with what its log has."""
    return subprocess.Popen(COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)


def say(**request):
    """Send one line, and read one."""
    live.stdin.write(json.dumps(request).encode() + b"\n")
    live.stdin.flush()
    return json.loads(live.stdout.readline())


def press(pose):
    """The image of one press."""
    return world.press(pose, rng)[0].tolist()


live, number = start(), 0
while (question := say(do="ask"))["action"] is not None:
    step, number = question["step"], number + (question["action"] == "touch")
    print(f"object {question['object'] + 1}: {question['action']} {question.get('pose', '')}", end="")
    if question["action"] != "touch":
        say(do="tell", step=step, done=True)
        if question["action"] == "reject":
            world.advance()
    elif number == 2:  # the arm stopped elsewhere, and says where
        answer = say(do="tell", step=step, pose="y90", image=press("y90"))
        print(f", but made in y90: {answer['told']}", end="")
    elif number == 3:  # nothing was there
        answer = say(do="tell", step=step, missed=True)
        print(f": {answer['told']}, asked again", end="")
    else:
        touch = {"do": "tell", "step": step, "image": press(question["pose"])}
        say(**touch)
        if number == 1:  # the network repeats the message, much later
            print(f", told twice: {say(**touch)['error']}", end="")
        if number == 4:  # the power fails
            live.kill()
            live.communicate()
            live = start()
            print(f", killed, at step {say(do='state')['step']} again", end="")
    print()
end = say(do="reveal", arrangement=objects)
live.communicate()
print(f"{end['outcome']}, right: {end['success']}, {end['num_touches']} touches, log of {log.stat().st_size} bytes")
