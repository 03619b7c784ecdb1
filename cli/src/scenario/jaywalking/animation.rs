//! The planner on board beside a cached plan.

use crate::plot::{AnimatedBody, AnimatedRun, Animation, outputs};
use crate::scenario::jaywalking::Args;
use crate::scenario::jaywalking::geometry::{CAR, Manoeuvre, RADIUS, SwerveGeometry};
use crate::scenario::jaywalking::planning::{ENTERS, PlanCallOutcome, Planning};

/// What is shown, in m.
const SHOWN: [[f64; 2]; 2] = [[-6.0, 20.0], [-4.0, 10.0]];

/// One animation, at the first speed; none without responses.
pub(crate) fn animations(args: &Args, geometry: &SwerveGeometry) -> Vec<Animation> {
    let speed = args.speed.first().copied();
    let responses = args.response.first().copied().zip(args.response.last().copied());
    let (Some(speed), Some((planner, cached))) = (speed, responses) else { return Vec::new() };
    let run = |name: &str, cloud| {
        let outcome = Planning { cloud, planner, cached }.run(true);
        let response = outcome.response;
        let contact = geometry.contact(speed, Manoeuvre::Swerve, response);
        let end = (geometry.distance + CAR.0 + 2.0) / speed;
        let car = |now: f64| {
            let car = geometry.swerved(now, speed, response);
            (car.front, car.heading)
        };
        let person = |now: f64| (geometry.person(now), [0.0, 1.0]);
        let enters = std::time::Duration::from_nanos(ENTERS).as_secs_f64();
        let emitted = outcome.trace.map(|trace| outputs(&trace, enters)).unwrap_or_default();
        let word = if contact.is_some() { "hits the person" } else { "swerves in time" };
        AnimatedRun {
            name: format!("{name}, {response} s"),
            outcome: word.to_owned(),
            collides: contact.is_some(),
            decided: Some(response),
            bodies: vec![
                AnimatedBody::new("ego", [CAR.0, CAR.1], (end, contact), car),
                AnimatedBody::new("person", [2.0 * RADIUS; 2], (end, contact), person),
            ],
            outputs: emitted.into_iter().filter(|(at, _)| (0.0..=end).contains(at)).collect(),
        }
    };
    let runs = vec![
        run("Planner on board", PlanCallOutcome::Unasked),
        run("Cached plan", PlanCallOutcome::InTime),
    ];
    let caption = format!(
        "At {speed} m/s, the person steps out at 0 s. Marks: the planner's outputs, as its trace has them; the first one \
         after 0 s is the swerve."
    );
    let road = vec![[-30.0, -1.75], [40.0, -1.75], [40.0, 5.25], [-30.0, 5.25]];
    vec![Animation { caption, shown: SHOWN, still: vec![("road", road)], runs }]
}
