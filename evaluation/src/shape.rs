//! Shapes on the road, seen from above, in metres, and when moving shapes touch.

/// A position or a displacement: x, y.
pub(crate) type Point = [f64; 2];

/// Shapes nearer than this touch.
const TOUCH: f64 = 1e-6;
/// The shortest step in time that is made towards a contact, in s.
const STEP: f64 = 1e-6;

/// A rectangle; its heading is a direction of length 1.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rectangle {
    /// The middle of its front.
    pub(crate) front: Point,
    pub(crate) heading: Point,
    pub(crate) length: f64,
    pub(crate) width: f64,
}

impl Rectangle {
    /// Returns the front's left and right ends, then the rear's right and left ends.
    pub(crate) fn corners(&self) -> [Point; 4] {
        let ([x, y], [along, across], half) = (self.front, self.heading, self.width / 2.0);
        let corner = |back: f64, left: f64| {
            [x - back * along - left * across, y - back * across + left * along]
        };
        [
            corner(0.0, half),
            corner(0.0, -half),
            corner(self.length, -half),
            corner(self.length, half),
        ]
    }

    /// Returns the distance to a point, which is 0 if the point lies inside.
    pub(crate) fn distance_to(&self, point: Point) -> f64 {
        let ([x, y], [along, across]) = (self.front, self.heading);
        let apart = [point[0] - x, point[1] - y];
        let before = apart[0] * along + apart[1] * across;
        let aside = (apart[1] * along - apart[0] * across).abs();
        let beyond = before.max(-self.length - before).max(0.0);
        beyond.hypot((aside - self.width / 2.0).max(0.0))
    }

    /// Returns the distance to another rectangle, which is 0 if they overlap.
    pub(crate) fn distance(&self, other: &Self) -> f64 {
        let (mine, theirs) = (self.corners(), other.corners());
        let cross = edges(&mine).any(|edge| edges(&theirs).any(|other| do_cross(edge, other)));
        if cross {
            return 0.0;
        }
        let to_mine = theirs.iter().map(|corner| self.distance_to(*corner));
        let to_theirs = mine.iter().map(|corner| other.distance_to(*corner));
        to_mine.chain(to_theirs).fold(f64::INFINITY, f64::min)
    }
}

/// Returns when two things first touch, from `from` until `to`. `distance` returns their distance
/// at an instant, and they approach each other by at most `fastest` m/s.
///
/// It skips the time in which they cannot touch yet. It may miss a graze that lasts less than a
/// millionth of a second.
pub(crate) fn first_contact(
    (from, to): (f64, f64),
    fastest: f64,
    distance: impl Fn(f64) -> f64,
) -> Option<f64> {
    let mut now = from;
    while now < to {
        let left = distance(now);
        if left < TOUCH {
            return Some(now);
        }
        now += (left / fastest).max(STEP);
    }
    None
}

/// Returns `true` if a straight line of sight from `from` to `to` meets the outline of a polygon.
pub(crate) fn is_hidden(polygon: &[Point], from: Point, to: Point) -> bool {
    edges(polygon).any(|edge| do_cross([from, to], edge))
}

fn edges(polygon: &[Point]) -> impl Iterator<Item = [Point; 2]> {
    let next = polygon.iter().cycle().skip(1);
    polygon.iter().zip(next).map(|(one, other)| [*one, *other])
}

/// Returns a number above 0 if `third` lies to the left of the way from `first` to `second`, and
/// below 0 if it lies to the right.
fn side([first, second]: [Point; 2], third: Point) -> f64 {
    (second[0] - first[0]) * (third[1] - first[1]) - (second[1] - first[1]) * (third[0] - first[0])
}

/// Returns `true` if two segments cross between their ends. Segments that only touch do not cross,
/// because an end of one lies on the other.
fn do_cross(one: [Point; 2], other: [Point; 2]) -> bool {
    let is_between =
        |line: [Point; 2], [from, to]: [Point; 2]| side(line, from) * side(line, to) < 0.0;
    is_between(one, other) && is_between(other, one)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn car(x: f64, y: f64, degrees: f64) -> Rectangle {
        let (across, along) = degrees.to_radians().sin_cos();
        Rectangle { front: [x, y], heading: [along, across], length: 4.0, width: 2.0 }
    }

    #[test]
    fn distances_are_those_of_the_nearest_places() {
        let near = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-9, "{found}");
        near(car(0.0, 0.0, 0.0).distance(&car(7.0, 0.0, 0.0)), 3.0);
        near(car(0.0, 0.0, 0.0).distance(&car(7.0, 6.0, 0.0)), 5.0);
        near(car(0.0, 0.0, 0.0).distance(&car(1.0, 0.5, 90.0)), 0.0);
        near(car(0.0, 0.0, 0.0).distance(&car(-1.0, 0.2, 0.0)), 0.0);
        near(car(0.0, 0.0, 0.0).distance_to([3.0, 5.0]), 5.0);
        near(car(0.0, 0.0, 0.0).distance_to([-1.0, 0.0]), 0.0);
        // A corner before a side: 45 degrees.
        near(car(0.0, 0.0, 0.0).distance(&car(4.0, 0.0, 225.0)), 4.0 - 0.5_f64.sqrt());
    }

    #[test]
    fn what_moves_touches_when_the_distance_is_gone_and_not_before() {
        let wall = car(14.0, 0.0, 0.0);
        let touch = first_contact((0.0, 10.0), 5.0, |now| car(2.0 * now, 0.0, 0.0).distance(&wall));
        assert!((touch.unwrap() - 5.0).abs() < 1e-5, "{touch:?}");
        let beside = |now: f64| car(2.0 * now, 2.001, 0.0).distance(&wall);
        assert_eq!(first_contact((0.0, 20.0), 5.0, beside), None);
    }

    #[test]
    fn a_house_hides_what_is_behind_it() {
        let house = [[-10.0, -10.0], [-5.0, -10.0], [-5.0, -5.0], [-10.0, -5.0]];
        assert!(is_hidden(&house, [-20.0, -2.0], [0.0, -12.0]));
        assert!(!is_hidden(&house, [-20.0, -2.0], [0.0, -3.0]));
    }
}
