"""A model that is a process of its own, so that it can be killed: `python3 model.py SOURCE`."""

import sys
import threading

from roles import Model

if __name__ == "__main__":
    Model(sys.argv[1])
    print("ready", flush=True)
    threading.Event().wait()
