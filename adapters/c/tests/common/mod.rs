//! The configuration of the machines that the tests make.

use fuseline_c::*;

pub(crate) const LAYOUT: u32 = size_of::<CConfig>() as u32
    | (size_of::<CCloud>() as u32) << 8
    | (size_of::<CAnswer>() as u32) << 16
    | ((size_of::<CState>() ^ size_of::<CMessage>()) as u32) << 24;

pub(crate) const CLOUDS: [CCloud; 3] = [
    CCloud { priority: 3, limit: 31, resume: 30 },
    CCloud { priority: 1, limit: 31, resume: 30 },
    CCloud { priority: 2, limit: 31, resume: 30 },
];

pub(crate) fn config() -> CConfig {
    CConfig {
        abi: FUSELINE_ABI,
        layout: LAYOUT,
        capacity: CCapacity::C3W16 as u32,
        commit: CCommit::Eager as u32,
        window: 16,
        clouds_len: 3,
        clouds: CLOUDS.as_ptr(),
        greatest_deadline: 1_000,
    }
}
