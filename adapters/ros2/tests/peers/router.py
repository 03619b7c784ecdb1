"""A router of Zenoh, as `rmw_zenohd` is one: the others meet through it.

    python3 router.py [FILE] [KEY=VALUE…]     its configuration, and changes of it, each value in JSON5
"""

import sys
import threading

import zenoh

USUAL = {"mode": '"router"', "listen/endpoints": '["tcp/127.0.0.1:7447"]', "scouting/multicast/enabled": "false"}

if __name__ == "__main__":
    files = [word for word in sys.argv[1:] if "=" not in word]
    config = zenoh.Config.from_file(files[0]) if files else zenoh.Config()
    changes = dict(change.split("=", 1) for change in sys.argv[1:] if "=" in change)
    for key, value in (({} if files else USUAL) | changes).items():
        config.insert_json5(key, value)
    with zenoh.open(config):
        print("ready", flush=True)
        threading.Event().wait()
