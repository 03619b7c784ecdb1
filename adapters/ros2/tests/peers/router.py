"""A router of Zenoh, as `rmw_zenohd` is one: the others meet through it.

    python3 router.py [KEY=VALUE…]     changes of its configuration, each value in JSON5
"""

import sys
import threading

import zenoh

USUAL = {"mode": '"router"', "listen/endpoints": '["tcp/127.0.0.1:7447"]', "scouting/multicast/enabled": "false"}

if __name__ == "__main__":
    config = zenoh.Config()
    for key, value in (USUAL | dict(change.split("=", 1) for change in sys.argv[1:])).items():
        config.insert_json5(key, value)
    with zenoh.open(config):
        print("ready", flush=True)
        threading.Event().wait()
