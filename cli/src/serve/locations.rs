//! The service that shares locations: each vehicle's last report, for the others.

use std::collections::BTreeMap;
use std::future::ready;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use fuseline_tokio::grpc::tonic::Status;
use fuseline_tokio::grpc::{Description, Infer, Reply, Request};
use prost::Message;
use tokio::time::Instant;

use crate::serve::location::{Location, Locations};

/// The longest name of a vehicle, in bytes.
const NAME: usize = 64;

/// Keeps the last report of each vehicle, and answers each report with the others'.
///
/// The last is the one of the greatest common time, so that reports may overtake each other. What is
/// older than the greatest age, since it came here, is forgotten.
pub(crate) struct LocationService {
    most: usize,
    age: Duration,
    reports: Mutex<BTreeMap<String, StoredReport>>,
}

struct StoredReport {
    location: Location,
    received_at: Instant,
}

impl LocationService {
    /// Nobody yet, and never more than `most` vehicles.
    pub(crate) const fn new(most: usize, age: Duration) -> Self {
        Self { most, age, reports: Mutex::new(BTreeMap::new()) }
    }

    /// Takes a report, and returns the others'.
    fn share(&self, location: Location, now: Instant) -> Result<Locations, Status> {
        check(&location)?;
        let mut reports = self.reports.lock().unwrap_or_else(PoisonError::into_inner);
        reports.retain(|_, report| now.saturating_duration_since(report.received_at) <= self.age);
        if reports.len() >= self.most && !reports.contains_key(&location.vehicle) {
            let most = self.most;
            return Err(Status::resource_exhausted(format!("{most} vehicles share already")));
        }
        let name = location.vehicle.clone();
        let is_newer =
            reports.get(&name).is_none_or(|report| report.location.time_s < location.time_s);
        if is_newer {
            reports.insert(name.clone(), StoredReport { location, received_at: now });
        }
        let others = reports.iter().filter(|(vehicle, _)| **vehicle != name);
        Ok(Locations { others: others.map(|(_, report)| report.location.clone()).collect() })
    }
}

impl Infer for LocationService {
    fn infer(&self, request: Request) -> impl Future<Output = Result<Reply, Status>> + Send {
        let location = Location::decode(request.payload)
            .map_err(|_| Status::invalid_argument("the payload is no fuseline.v1.Location"));
        let others = location.and_then(|location| self.share(location, Instant::now()));
        let payload = others.map(|others| others.encode_to_vec().into());
        ready(payload.map(|payload| Reply { payload, ..Reply::default() }))
    }

    fn describe(&self) -> Option<Description> {
        Some(Description { model: "locations of vehicles".to_owned(), ..Description::default() })
    }
}

/// Whether it can be the report of a vehicle.
fn check(location: &Location) -> Result<(), Status> {
    let Location { vehicle, time_s, x_m, y_m, vx_mps, vy_mps } = location;
    if vehicle.is_empty() || vehicle.len() > NAME {
        return Err(Status::invalid_argument("a vehicle's name has 1 to 64 bytes"));
    }
    let is_finite = [time_s, x_m, y_m, vx_mps, vy_mps].into_iter().all(|number| number.is_finite());
    is_finite.then_some(()).ok_or_else(|| Status::invalid_argument("a number is not finite"))
}

#[cfg(test)]
mod tests {
    use fuseline_tokio::grpc::tonic::Code;

    use super::*;

    const AGE: Duration = Duration::from_secs(5);

    fn at(vehicle: &str, time_s: f64) -> Location {
        Location { vehicle: vehicle.to_owned(), time_s, x_m: time_s, ..Location::default() }
    }

    fn reported(
        sharing: &LocationService,
        vehicle: &str,
        time_s: f64,
        now: Instant,
    ) -> Vec<(String, f64)> {
        let reported = sharing.share(at(vehicle, time_s), now).unwrap();
        reported.others.into_iter().map(|other| (other.vehicle, other.time_s)).collect()
    }

    #[test]
    fn each_has_the_last_reports_of_the_others() {
        let (sharing, now) = (LocationService::new(9, AGE), Instant::now());
        assert_eq!(reported(&sharing, "ego", 1.0, now), []);
        assert_eq!(reported(&sharing, "runner", 1.1, now), [("ego".to_owned(), 1.0)]);
        assert_eq!(reported(&sharing, "ego", 1.2, now), [("runner".to_owned(), 1.1)]);
        // One that was overtaken changes nothing.
        assert_eq!(reported(&sharing, "ego", 1.1, now), [("runner".to_owned(), 1.1)]);
        assert_eq!(reported(&sharing, "runner", 1.2, now), [("ego".to_owned(), 1.2)]);
    }

    #[test]
    fn what_is_too_old_is_forgotten() {
        let (sharing, now) = (LocationService::new(9, AGE), Instant::now());
        reported(&sharing, "ego", 1.0, now);
        assert_eq!(reported(&sharing, "runner", 1.0, now + AGE).len(), 1);
        assert_eq!(reported(&sharing, "runner", 2.0, now + AGE + Duration::from_nanos(1)), []);
    }

    #[test]
    fn there_are_never_more_vehicles_than_allowed() {
        let (sharing, now) = (LocationService::new(2, AGE), Instant::now());
        reported(&sharing, "a", 1.0, now);
        reported(&sharing, "b", 1.0, now);
        let refused = sharing.share(at("c", 1.0), now).unwrap_err();
        assert_eq!(
            (refused.code(), refused.message()),
            (Code::ResourceExhausted, "2 vehicles share already")
        );
        assert_eq!(reported(&sharing, "b", 2.0, now).len(), 1);
        assert_eq!(reported(&sharing, "c", 1.0, now + AGE * 2), []);
    }

    #[tokio::test]
    async fn what_no_vehicle_says_is_refused() {
        let (sharing, now) = (LocationService::new(9, AGE), Instant::now());
        for wrong in [at("", 1.0), at(&"x".repeat(65), 1.0), at("ego", f64::NAN)] {
            assert_eq!(sharing.share(wrong, now).unwrap_err().code(), Code::InvalidArgument);
        }
        let payload = vec![0xff; 3].into();
        let request = Request { payload, ..Request::default() };
        let refused = sharing.infer(request).await.unwrap_err();
        assert_eq!(refused.code(), Code::InvalidArgument);
        assert!(sharing.reports.lock().unwrap().is_empty());
    }
}
