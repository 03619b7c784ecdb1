"""A router of Zenoh, as `rmw_zenohd` is one: the others meet through it.

    python3 router.py [PORT]
"""

import sys
import threading

import zenoh

if __name__ == "__main__":
    config = zenoh.Config()
    port = sys.argv[1] if len(sys.argv) > 1 else "7447"
    for key, value in {"mode": '"router"', "listen/endpoints": f'["tcp/127.0.0.1:{port}"]',
                       "scouting/multicast/enabled": "false"}.items():
        config.insert_json5(key, value)
    with zenoh.open(config):
        print("ready", flush=True)
        threading.Event().wait()
