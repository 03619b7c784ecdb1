"""A model that is a process of its own, so that it can be killed; it subscribes to the other topics too, reliably.

    python3 model.py SOURCE [TOPIC…]
"""

import sys
import threading

from graph import Peer
from messages import PointStamped
from roles import Model

if __name__ == "__main__":
    Model(sys.argv[1])
    others = [Peer().subscribes(topic, PointStamped, keep=False) for topic in sys.argv[2:]]
    print("ready", flush=True)
    threading.Event().wait()
