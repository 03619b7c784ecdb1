//! The plain data of the interface. `include/fuseline.h` is made from this file; a test compares them.
#![expect(clippy::doc_markdown, reason = "these texts are the header's, which has no markdown")]

/// The version of this interface. A library refuses a header of another one.
pub const FUSELINE_ABI: u32 = 2;
/// The most sources of a machine: local and 15 clouds.
pub const FUSELINE_SOURCES: usize = 16;
/// Of the bytes that a machine's storage takes: those that each machine takes.
pub const FUSELINE_BYTES: usize = 256;
/// Those for each cloud.
pub const FUSELINE_BYTES_A_CLOUD: usize = 64;
/// Those for each timestamp of the window.
pub const FUSELINE_BYTES_A_TIMESTAMP: usize = 96;
/// Those for each timestamp and cloud.
pub const FUSELINE_BYTES_A_TIMER: usize = 8;

/// Of the bytes that the storage of a machine for many threads takes: those that each machine takes.
pub const FUSELINE_SHARED_BYTES: usize = 256;
/// Those for each cloud.
pub const FUSELINE_SHARED_BYTES_A_CLOUD: usize = 128;

/// Whether a call was applied. From FUSELINE_STATUS_NULL on it was wrong and changed nothing.
#[repr(u32)]
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum CStatus {
    /// The input was applied: the answer is its own.
    Done = 0,
    /// Timers fired first (F5): the answer is theirs and the input was not applied. Act on the answer, then make the
    /// same call again.
    Again = 1,
    /// There is nothing to report: no timer is armed, the timestamp is not open, or the priority is no cloud's.
    None = 2,
    /// A pointer is null.
    Null = 16,
    /// A pointer is not aligned for what it points to.
    Alignment = 17,
    /// The storage is too small for the capacity.
    Size = 18,
    /// An answer would lie in the machine's storage, or two answers of one call would share bytes.
    Overlap = 19,
    /// No machine is there: never initialised, ended, copied from elsewhere, or overwritten.
    Foreign = 20,
    /// Another call to this machine is under way, which this one interrupted.
    Busy = 21,
    /// The header is of another version than the library.
    Abi = 22,
    /// The library does not hold a machine of exactly this many clouds and this window.
    Capacity = 23,
    /// No such commit rule.
    Commit = 24,
    /// The window is 0 or above the capacity.
    Window = 25,
    /// There are more clouds than the capacity allows.
    Clouds = 26,
    /// A cloud's priority is not from 1 to 65535.
    Priority = 27,
    /// Two clouds have one priority (A10).
    Twice = 28,
    /// A cloud's gate does not resume below its limit (F2g).
    Gate = 29,
    /// The greatest deadline is 0: every deadline would be refused.
    Deadline = 30,
    /// The message id names no message of this machine: another machine gave it, or none did.
    MessageId = 31,
}

/// How much a machine has room for: 65536 times the clouds, plus the open timestamps (FUSELINE_CAPACITY_OF). A library
/// may hold one more: that of FUSELINE_OWN_CLOUDS and FUSELINE_OWN_WINDOW, see fuseline_own_capacity.
#[repr(u32)]
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum CCapacity {
    /// 1 cloud, a window of 4.
    C1W4 = 0x1_0004,
    /// 3 clouds, a window of 16.
    C3W16 = 0x3_0010,
    /// 7 clouds, a window of 64.
    C7W64 = 0x7_0040,
    /// 15 clouds, a window of 1024: whatever SPEC.md allows.
    C15W1024 = 0xf_0400,
}

/// The number of a capacity: the header's FUSELINE_CAPACITY_OF.
#[expect(clippy::cast_possible_truncation, reason = "at most 15 clouds and a window of 1024")]
pub(crate) const fn capacity_of(clouds: usize, window: usize) -> u32 {
    (clouds as u32) << 16 | window as u32
}
const _: () = {
    assert!(CCapacity::C1W4 as u32 == capacity_of(1, 4), "its name says it");
    assert!(CCapacity::C3W16 as u32 == capacity_of(3, 16), "its name says it");
    assert!(CCapacity::C7W64 as u32 == capacity_of(7, 64), "its name says it");
    assert!(CCapacity::C15W1024 as u32 == capacity_of(15, 1024), "its name says it");
};

/// When a result is forwarded although a better one is pending (F6, F9).
#[repr(u32)]
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum CCommit {
    /// The first cloud's timer that fires commits the best available one.
    Eager = 0,
    /// The best available one is forwarded once nothing pending outranks it.
    Patient = 1,
    /// Each result that is better than those before it is sent at once: FUSELINE_OUTCOME_PRELIMINARY while better ones may
    /// follow.
    Progressive = 2,
}

/// What became of an input, or of timers that fired.
#[repr(u32)]
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum COutcome {
    /// A tick: time went by.
    Nothing = 0,
    /// Open: the timestamp is open and waits for local.
    Accepted = 1,
    /// Open, offer: for the reason `why`; nothing changed but a gate. A refused request must not be sent.
    Refused = 2,
    /// Offer: send the request; its result is in time before `due`.
    Admitted = 3,
    /// Result: keep its value, for something pending outranks it.
    Held = 4,
    /// Send the value of `by` downstream. The timestamp is retired: discard what else is held for it, and abort the
    /// calls of `cancelled` if you like.
    Forwarded = 5,
    /// Result, failure: for the reason `why`; nothing changed. Discard its value.
    Dropped = 6,
    /// Nothing came and nothing will: the timestamp is retired.
    Missed = 7,
    /// Failure, timers: the timestamp stays open.
    Waiting = 8,
    /// Result, progressive alone: send the value of `by` downstream, and abort the calls of `cancelled` if you like. The
    /// timestamp stays open for better values, until the last is FUSELINE_OUTCOME_FORWARDED or FUSELINE_OUTCOME_FINAL comes.
    Preliminary = 9,
    /// Failure, timers, progressive alone: the value of `by`, sent before, was the last. The timestamp is retired, and there
    /// is nothing to send.
    Final = 10,
}

/// Why an input was refused or dropped: the first reason that holds, in the order of SPEC.md.
#[repr(u32)]
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum CReason {
    /// It was neither.
    None = 0,
    /// Open: this timestamp or a later one was opened before.
    Order = 1,
    /// Open: as many timestamps are open as the window allows.
    Full = 2,
    /// Open, offer: the due instant is not after now, or the deadline is above the greatest one of the configuration.
    Deadline = 3,
    /// No such source, or neither this timestamp nor a later one was ever opened.
    Unknown = 4,
    /// Offer: the timestamp is not open.
    Closed = 5,
    /// The cloud was requested before; the source's result is already held or, under progressive, was sent last.
    Duplicate = 6,
    /// Offer: a held result, or under progressive the last one sent, outranks whatever this cloud would return.
    Outranked = 7,
    /// Offer: the cloud's gate is shut.
    Queue = 8,
    /// Result, failure: the timestamp is not open or, under progressive, the last result sent outranks the source's.
    Superseded = 9,
    /// Result, failure: no request was made to the source.
    Unsolicited = 10,
    /// Result, failure: the request was closed by its timer or by a failure.
    Late = 11,
}

/// One cloud as configured.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct CCloud {
    /// 1 to 65535, unlike every other cloud's; the greater wins.
    pub priority: u64,
    /// The gate shuts at this many queued requests; at least 1.
    pub limit: u64,
    /// The shut gate opens at this many queued requests or fewer; less than `limit`.
    pub resume: u64,
}

/// What a machine is made for. FUSELINE_CONFIG gives the first two members.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct CConfig {
    /// FUSELINE_ABI.
    pub abi: u32,
    /// FUSELINE_LAYOUT.
    pub layout: u32,
    /// A fuseline_capacity, or FUSELINE_CAPACITY_OF your own.
    pub capacity: u32,
    /// A fuseline_commit.
    pub commit: u32,
    /// How many timestamps may be open at once: 1 to the capacity's.
    pub window: u32,
    /// How many clouds there are: 0 to the capacity's.
    pub clouds_len: u32,
    /// The clouds in any order; may be null if there is none. Not used after the call.
    pub clouds: *const CCloud,
    /// A deadline of more nanoseconds is refused, FUSELINE_REASON_DEADLINE: so is a negative one, which is huge without
    /// its sign. 1 or more; what the system may wait for a message in the worst case.
    pub greatest_deadline: u64,
}

/// What a call decided, whole: nothing else happened.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct CAnswer {
    /// The machine's clock at which it was decided, in nanoseconds (F0).
    pub at: u64,
    /// The timestamp that it is about; of a tick 0.
    pub t: u64,
    /// When the timers that fired were due, or by when an admitted request's result must be there; else 0.
    pub due: u64,
    /// What became of the input or of the timers.
    pub outcome: COutcome,
    /// Why it was refused or dropped.
    pub why: CReason,
    /// Forwarded, preliminary, final: whose result; 0 is local's. Else 0.
    pub by: u32,
    /// 1 if timers fired (FUSELINE_STATUS_AGAIN), else 0.
    pub fired: u32,
    /// How many of `timers` mean something; the others are 0.
    pub timers_len: u32,
    /// How many of `cancelled` mean something; the others are 0.
    pub cancelled_len: u32,
    /// The priorities whose timers fired, ascending; 0 is local's.
    pub timers: [u16; FUSELINE_SOURCES],
    /// Forwarded, preliminary: the clouds whose results are no longer wanted, ascending.
    pub cancelled: [u16; FUSELINE_SOURCES],
}

/// The state of a machine as a whole.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct CState {
    /// The greatest instant seen, in nanoseconds.
    pub now: u64,
    /// The greatest timestamp ever opened; means something if `has_newest` is 1.
    pub newest: u64,
    /// The next due instant; means something if `has_due` is 1.
    pub due: u64,
    /// 1 if a timestamp was ever opened, else 0.
    pub has_newest: u32,
    /// 1 if a timer is armed, else 0.
    pub has_due: u32,
    /// How many timestamps are open.
    pub open_len: u32,
    /// How many may be.
    pub window: u32,
}

/// The state of an open timestamp: sets of sources, a bit each. Bit `i` is the source `priorities[i]`.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct CMessage {
    /// When each source's timer is due, if it is in `armed`.
    pub dues: [u64; FUSELINE_SOURCES],
    /// The sources' priorities, ascending; the first is local's, 0.
    pub priorities: [u16; FUSELINE_SOURCES],
    /// How many sources there are: local and the clouds.
    pub sources_len: u32,
    /// Requested.
    pub requested: u32,
    /// Requested, and neither result nor failure nor timer has come.
    pub pending: u32,
    /// Those whose timer is live.
    pub armed: u32,
    /// Those whose result is held; under progressive the one whose result was sent last.
    pub cached: u32,
    /// 0.
    pub reserved: u32,
}

/// Names one open message to the machine for many threads that opened it. Another machine refuses it, and one that is
/// all 0, FUSELINE_STATUS_MESSAGE_ID.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct CMessageId {
    /// Opaque.
    pub opaque: [u64; 3],
}

/// What the header's FUSELINE_LAYOUT is where it was compiled: the sizes of the interface's structures.
pub(crate) const LAYOUT: u32 = {
    let sizes = [
        size_of::<CConfig>(),
        size_of::<CCloud>(),
        size_of::<CAnswer>(),
        size_of::<CState>() ^ size_of::<CMessage>(),
    ];
    let [config, cloud, answer, questions] = sizes;
    assert!(config < 256 && cloud < 256 && answer < 256 && questions < 256, "a byte holds each");
    #[expect(clippy::cast_possible_truncation, reason = "each is below 256, as asserted")]
    let layout =
        config as u32 | (cloud as u32) << 8 | (answer as u32) << 16 | (questions as u32) << 24;
    layout
};

impl CAnswer {
    pub(crate) const EMPTY: Self = Self {
        at: 0,
        t: 0,
        due: 0,
        outcome: COutcome::Nothing,
        why: CReason::None,
        by: 0,
        fired: 0,
        timers_len: 0,
        cancelled_len: 0,
        timers: [0; FUSELINE_SOURCES],
        cancelled: [0; FUSELINE_SOURCES],
    };
}
