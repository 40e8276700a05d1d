# %% [markdown]
# # Drive the simulated rover from another program
#
# `firnline simulate MISSION --serve` streams images and sensors in real time and drives as other programs command. This
# program reaches a goal: it counts wheels and gyro for its place, corrects the place by GPS fixes, and commands speed and
# turn at every image. Topics, frames and units are on the page [A rover for other programs](../howto/serve.md); Foxglove
# opens the same address. It needs `pip install firnline[live]`.

# %%
import base64
import cmath
import io
import json
import math
import signal
import struct
import subprocess
import sys

from matplotlib import pyplot as plt
from websockets.sync.client import connect

GOAL, DEGREE_M = -6 + 5j, 111_200.0  # east and north of the start [m]; a degree of latitude
firnline = [sys.executable, "-m", "firnline"]
subprocess.run([*firnline, "example", "short_drive"], check=True)
serve = [*firnline, "simulate", "short_drive.toml", "--serve", "--listen", "127.0.0.1:0"]
server = subprocess.Popen(serve, stderr=subprocess.PIPE, text=True)
address = server.stderr.readline().split(": ")[0]  # ws://127.0.0.1:PORT

# %% [markdown]
# Places are complex numbers: east is real, north imaginary.

# %%
place, heading, rolled_m, fixes, path = 0j, 0.0, 0.0, [], []
with connect(address, subprotocols=["foxglove.sdk.v1"], max_size=None) as link:
    _, channels = link.recv(), json.loads(link.recv())["channels"]
    topics = {one["id"]: one["topic"] for one in channels}
    command = {"id": 1, "topic": "/cmd_vel", "encoding": "json", "schemaName": "geometry_msgs/Twist"}
    link.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": k, "channelId": k} for k in topics]}))
    link.send(json.dumps({"op": "advertise", "channels": [command]}))
    while abs(GOAL - place) > 0.5:
        data = link.recv()
        topic = topics[struct.unpack_from("<BI", data)[1]] if data[0] == 1 else "time"
        message = json.loads(data[13:]) if data[0] == 1 else {}
        if topic == "/tf_static":  # the heading of the start
            turn = next(one["rotation"] for one in message["transforms"] if one["child_frame_id"] == "odom")
            heading = 2.0 * math.atan2(turn["z"], turn["w"])
        elif topic == "/imu/data":  # 80 a second
            heading += message["angular_velocity"]["z"] / 80.0
        elif topic == "/wheel/odometry":
            before_m, rolled_m = rolled_m, 0.5 * (message["left_m"] + message["right_m"])
            place += cmath.rect(rolled_m - before_m, heading)
        elif topic == "/gps/fix":
            fixes.append(complex(message["longitude"], message["latitude"]))
            away, parallel = fixes[-1] - fixes[0], math.cos(math.radians(message["latitude"]))
            place += 0.05 * (complex(away.real * parallel, away.imag) * DEGREE_M - place)
        elif topic == "/camera/image":
            jpeg = base64.b64decode(message["data"])
            angle = cmath.phase((GOAL - place) * cmath.rect(1.0, -heading))
            speed_m_s, turn_rad_s = 0.6 * max(math.cos(angle), 0.0), max(-0.6, min(0.6, angle))
            twist = {"linear": {"x": speed_m_s}, "angular": {"z": turn_rad_s}}
            link.send(struct.pack("<BI", 1, 1) + json.dumps(twist).encode())
            path.append(place)
server.send_signal(signal.SIGINT)
print(server.communicate()[1])

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.5))
left.imshow(plt.imread(io.BytesIO(jpeg), "jpeg"), cmap="gray")
right.plot([at.real for at in path], [at.imag for at in path], "-", GOAL.real, GOAL.imag, "*")
