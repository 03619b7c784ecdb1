//! The messages of `proto/locations.proto`.

/// Where a vehicle is and how it moves, in a frame and by a clock that all vehicles have in common.
#[derive(Clone, PartialEq, prost::Message)]
pub(crate) struct Location {
    /// The vehicle's name: 1 to 64 bytes, no other vehicle's.
    #[prost(string, tag = "1")]
    pub(crate) vehicle: String,
    /// When it was so, in seconds by the common clock.
    #[prost(double, tag = "2")]
    pub(crate) time_s: f64,
    /// The position, in metres.
    #[prost(double, tag = "3")]
    pub(crate) x_m: f64,
    #[prost(double, tag = "4")]
    pub(crate) y_m: f64,
    /// The velocity, in metres a second.
    #[prost(double, tag = "5")]
    pub(crate) vx_mps: f64,
    #[prost(double, tag = "6")]
    pub(crate) vy_mps: f64,
}

/// The last report of each other vehicle, those that are too old left out, by the vehicles' names.
#[derive(Clone, PartialEq, prost::Message)]
pub(crate) struct Locations {
    #[prost(message, repeated, tag = "1")]
    pub(crate) others: Vec<Location>,
}
