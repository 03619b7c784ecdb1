#![doc = include_str!("../README.md")]
#![no_std]

mod header;
mod inputs;
mod names;
mod plain;
#[cfg(feature = "threads")]
mod shared_storage;
mod storage;

pub mod calls;
#[cfg(feature = "cost")]
pub mod cost;
#[cfg(feature = "threads")]
pub mod shared;

pub use plain::{
    CAnswer, CCapacity, CCloud, CCommit, CConfig, CMessage, CMessageId, COutcome, CReason, CState,
    CStatus, FUSELINE_ABI, FUSELINE_BYTES, FUSELINE_BYTES_A_CLOUD, FUSELINE_BYTES_A_TIMER,
    FUSELINE_BYTES_A_TIMESTAMP, FUSELINE_SHARED_BYTES, FUSELINE_SHARED_BYTES_A_CLOUD,
    FUSELINE_SOURCES,
};
#[cfg(feature = "threads")]
pub use shared_storage::CShared;
pub use storage::CMachine;

/// Refers to a function that does not exist, so a library in which a panic can be reached does not
/// link.
#[cfg(all(feature = "library", panic = "abort", not(test)))]
#[panic_handler]
fn no_panic(_: &core::panic::PanicInfo<'_>) -> ! {
    #[expect(unsafe_code, reason = "a function of another language, which does not exist")]
    unsafe extern "C" {
        safe fn fuseline_a_panic_can_be_reached() -> !;
    }
    fuseline_a_panic_can_be_reached()
}
