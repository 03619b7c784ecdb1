//! Where round trips were measured, in metres.

use std::collections::BTreeMap;

use crate::probe::recording::PlotRow;

/// The chart's sides, in units of the drawing.
pub(crate) const CHART: (f64, f64) = (700.0, 520.0);
/// Metres in a degree of latitude.
const DEGREE: f64 = 111_195.0;
/// A standing vehicle is shown with so much around it, in metres.
const AROUND: f64 = 50.0;
/// No answer is slower than any.
pub(crate) const NO_ANSWER: u64 = u64::MAX;

/// What holds all positions, in degrees; longitudes count from the first.
#[derive(Clone, Copy)]
pub(crate) struct BoundingBox {
    first: f64,
    lat: (f64, f64),
    east: (f64, f64),
}

impl BoundingBox {
    pub(crate) const fn new((lat, lon): (f64, f64)) -> Self {
        Self { first: lon, lat: (lat, lat), east: (0.0, 0.0) }
    }

    pub(crate) fn add(&mut self, (lat, lon): (f64, f64)) {
        let east = self.east(lon);
        self.lat = (self.lat.0.min(lat), self.lat.1.max(lat));
        self.east = (self.east.0.min(east), self.east.1.max(east));
    }

    /// The way east of the first, the short way round.
    fn east(&self, lon: f64) -> f64 {
        (lon - self.first + 540.0).rem_euclid(360.0) - 180.0
    }
}

/// The slowest of the round trips at each place, as finely as the drawing shows.
#[derive(Clone)]
pub(crate) struct SlowestPlaces {
    bounds: BoundingBox,
    /// Half of the chart's width and height, in metres.
    pub(crate) half: (f64, f64),
    /// In microseconds, by units of the drawing from the middle.
    slowest: BTreeMap<(i32, i32), u64>,
}

impl SlowestPlaces {
    pub(crate) fn new(bounds: BoundingBox) -> Self {
        let mut places = Self { bounds, half: (0.0, 0.0), slowest: BTreeMap::new() };
        let (east, north) = places.metres(bounds.east.1, bounds.lat.1);
        let unit = (east.max(AROUND) / CHART.0).max(north.max(AROUND) / CHART.1) * 1.08;
        places.half = (unit * CHART.0, unit * CHART.1);
        places
    }

    pub(crate) fn add(&mut self, plot_row: &PlotRow) {
        let Some((lat, lon)) = plot_row.position else { return };
        let (east, north) = self.metres(self.bounds.east(lon), lat);
        let unit = self.unit();
        let took = plot_row.round_trip.map_or(NO_ANSWER, micros);
        let slowest = self.slowest.entry((cell(east / unit), cell(north / unit))).or_insert(0);
        *slowest = took.max(*slowest);
    }

    /// Each place in metres from the middle, the slowest last, with its round trip in milliseconds;
    /// none if there was no answer.
    pub(crate) fn dots(&self) -> Vec<((f64, f64), Option<f64>)> {
        let unit = self.unit();
        let mut dots: Vec<_> = self.slowest.iter().collect();
        dots.sort_by_key(|(_, took)| **took);
        let dot = |((x, y), took): (&(i32, i32), &u64)| {
            #[expect(clippy::cast_precision_loss, reason = "at most a day")]
            let ms = (*took != NO_ANSWER).then_some(*took as f64 / 1000.0);
            ((f64::from(*x) * unit, f64::from(*y) * unit), ms)
        };
        dots.into_iter().map(dot).collect()
    }

    fn unit(&self) -> f64 {
        2.0 * self.half.0 / CHART.0
    }

    /// Degrees as metres from the middle.
    fn metres(&self, east: f64, lat: f64) -> (f64, f64) {
        let BoundingBox { lat: lats, east: easts, .. } = self.bounds;
        let middle = f64::midpoint(lats.0, lats.1);
        let across = (east - f64::midpoint(easts.0, easts.1)) * DEGREE;
        (across * middle.to_radians().cos(), (lat - middle) * DEGREE)
    }
}

#[expect(clippy::cast_possible_truncation, reason = "some hundreds")]
fn cell(at: f64) -> i32 {
    at.round() as i32
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most a day")]
fn micros(ms: f64) -> u64 {
    (ms * 1000.0) as u64
}
