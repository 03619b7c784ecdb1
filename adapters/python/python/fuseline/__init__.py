"""Computes each message on board and in clouds, and forwards the best result that is in time.

- `Operator` does that within asyncio, and `BlockingOperator` in programs without an event loop.
- `Fusion` is the machine that decides, without a clock or a network, for loops of your own.
- `Join` puts the outputs of several operators or sensors together.
- `check`, `check_observed` and `replay` judge recorded traces, and `report` shows them on a page.
- `fuseline.deadline` chooses deadlines.
- `fuseline.grpc` calls clouds and serves them.

SPEC.md defines the terms. Identifiers in parentheses, such as F3, refer to its rules.
"""

from importlib.metadata import version as _version

from fuseline._blocking import BlockingOperator
from fuseline._errors import (
    CallError,
    Closed,
    ConfigError,
    DeadlineError,
    Error,
    Full,
    ReadError,
    TimeError,
    TraceError,
)
from fuseline._fuseline import Fusion, Latency, nanoseconds
from fuseline._item import (
    Call,
    CurrentDeadline,
    Ending,
    Failure,
    Item,
    Lineage,
    Source,
    StampedValue,
    Trigger,
)
from fuseline._items import Items, OutOfOrder
from fuseline._join import Join, JoinCause, JoinDrop, JoinDropReason, Joined, JoinInput
from fuseline._judge import (
    Doubt,
    DoubtKind,
    Verdict,
    Violation,
    check,
    check_observed,
    replay,
    report,
)
from fuseline._local import Local
from fuseline._operator import Operator
from fuseline._state import CarriedState
from fuseline._trace import Line, Trace
from fuseline._validation import (
    Accepted,
    Admission,
    Admitted,
    Cloud,
    Commit,
    Dropped,
    DropReason,
    Final,
    Firing,
    Forwarded,
    Held,
    Missed,
    OfferRefusal,
    Opening,
    OpenRefusal,
    Outcome,
    Preliminary,
    Refused,
    Waiting,
    ns,
)

#: The version of the installed wheel.
__version__: str = _version("fuseline")

__all__ = [
    "Accepted",
    "Admission",
    "Admitted",
    "BlockingOperator",
    "Call",
    "CallError",
    "CarriedState",
    "Closed",
    "Cloud",
    "Commit",
    "ConfigError",
    "CurrentDeadline",
    "DeadlineError",
    "Doubt",
    "DoubtKind",
    "DropReason",
    "Dropped",
    "Ending",
    "Error",
    "Failure",
    "Final",
    "Firing",
    "Forwarded",
    "Full",
    "Fusion",
    "Held",
    "Item",
    "Items",
    "Join",
    "JoinCause",
    "JoinDrop",
    "JoinDropReason",
    "JoinInput",
    "Joined",
    "Latency",
    "Line",
    "Lineage",
    "Local",
    "Missed",
    "OfferRefusal",
    "OpenRefusal",
    "Opening",
    "Operator",
    "OutOfOrder",
    "Outcome",
    "Preliminary",
    "ReadError",
    "Refused",
    "Source",
    "StampedValue",
    "TimeError",
    "Trace",
    "TraceError",
    "Trigger",
    "Verdict",
    "Violation",
    "Waiting",
    "check",
    "check_observed",
    "nanoseconds",
    "ns",
    "replay",
    "report",
]
