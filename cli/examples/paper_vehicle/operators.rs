//! The vehicle's operators. What they compute is emulated: runtimes are the paper's where it has them, and a value says how
//! accurate the detector behind it is.

use std::num::NonZero;
use std::sync::Arc;
use std::time::{Duration, Instant};

use fuseline_tokio::handlers::{by_content, every_nth};
use fuseline_tokio::{CarriedState, Error, Item, Joined, Local, Operator, Setup, SharedState};

use super::world::{Kill, Network, VehiclePart};

const MS: Duration = Duration::from_millis(1);
const THIRD: NonZero<u64> = NonZero::new(3).unwrap();

/// How the vehicle computes.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Mode {
    Local,
    Cloud,
    Fusion,
}

/// What all operators know of the drive.
#[derive(Clone, Debug)]
pub(crate) struct Drive {
    pub(crate) mode: Mode,
    pub(crate) kill: Kill,
    /// Of the two detectors and the tracker.
    pub(crate) west: Network,
    pub(crate) east: Network,
    pub(crate) tracking: Network,
}

/// What the sensors see of one instant.
#[derive(Clone, Default, Debug)]
pub(crate) struct Scene {
    pub(crate) left: Option<Frame>,
    pub(crate) right: Option<Frame>,
    pub(crate) place: Option<u64>,
}

/// A camera's frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub(crate) captured: Instant,
    /// Whether somebody walks towards the road.
    pub(crate) walker: bool,
}

/// What was detected, tracked or planned.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct PerceivedScene {
    /// When the frame behind it was captured.
    pub(crate) captured: Instant,
    /// The box AP of the detector behind it; half with one camera.
    pub(crate) accuracy: f64,
    pub(crate) walker: bool,
    /// For how many frames in a row it was tracked.
    pub(crate) tracked: u32,
}

/// What may happen.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Prediction {
    seen: PerceivedScene,
    /// Trajectories of the walker, each with its probability.
    trajectories: [(&'static str, f64); 3],
}

/// What control needs.
#[derive(Clone, Default, Debug)]
pub(crate) struct Order {
    pub(crate) plan: Option<PerceivedScene>,
}

pub(crate) struct Detection(pub(crate) Drive);
pub(crate) struct Tracking(pub(crate) Drive);
pub(crate) struct Predicting(pub(crate) Drive);
pub(crate) struct Planning(pub(crate) Drive);
pub(crate) struct Control;

impl Operator for Detection {
    type Input = Joined<Scene>;
    type Output = PerceivedScene;

    fn setup(
        self,
        setup: &mut Setup<Joined<Scene>, PerceivedScene>,
    ) -> Local<Joined<Scene>, PerceivedScene> {
        let Drive { mode, kill, west, east, .. } = self.0;
        if mode != Mode::Local {
            // Frames that are not consecutive, which saves bandwidth; the two clouds alternate.
            let clouds = [
                ("west/dino-swin-t", VehiclePart::WestDetector, west, 90.1, 51.3, 0),
                ("east/detr-r101", VehiclePart::EastDetector, east, 118.2, 43.5, 1),
            ];
            for (priority, (name, part, network, runtime, accuracy, turn)) in (1..).zip(clouds) {
                let handle = move |seen: PerceivedScene, _| {
                    let network = network.clone();
                    async move {
                        network.round_trip().await;
                        kill.compute(part, ms(runtime), seen).await
                    }
                };
                let send =
                    move |scene: &Joined<Scene>, _| Some((detect(scene, accuracy)?, 400 * MS));
                let message_handler = every_nth(THIRD, turn, send);
                setup.use_cloud(handle, message_handler, Ok, priority).name = name.into();
            }
        }
        // The last boxes, older as they are.
        let last = keep_last(setup);
        setup.use_substitute(move |_| last.current());
        let mut local = Local::futures(4, move |scene: Arc<Joined<Scene>>, _| async move {
            let seen = detect(&scene, 42.0).filter(|_| mode != Mode::Cloud);
            kill.compute(
                VehiclePart::LocalDetector,
                ms(301.7),
                seen.ok_or("no detection on board")?,
            )
            .await
        });
        local.waiting = Some(1);
        local
    }
}

// ANCHOR: state
/// It sends its state along to its cloud, and goes on with the cloud's where that result is sent.
impl Operator for Tracking {
    type Input = Item<PerceivedScene>;
    type Output = PerceivedScene;

    fn setup(
        self,
        setup: &mut Setup<Item<PerceivedScene>, PerceivedScene>,
    ) -> Local<Item<PerceivedScene>, PerceivedScene> {
        let Drive { mode, kill, tracking, .. } = self.0;
        let state = CarriedState::<Option<PerceivedScene>>::new(None);
        setup.use_state(&state, |seen| Some(*seen));
        let along = state.clone();
        let handle = move |next: PerceivedScene, _| {
            let network = tracking.clone();
            async move {
                network.round_trip().await;
                kill.compute(VehiclePart::CloudTracker, 5 * MS, next).await
            }
        };
        // Only while there is somebody to track.
        let is_wanted = move |item: &Item<PerceivedScene>| {
            mode != Mode::Local && item.value().is_some_and(|seen| seen.walker)
        };
        let message_handler = by_content(is_wanted, move |item: &Item<PerceivedScene>, _| {
            Some((track(along.current(), *item.value()?), 60 * MS))
        });
        setup.use_cloud(handle, message_handler, Ok, 1).name = "tracker".into();
        let coast = state.clone();
        setup.use_substitute(move |_| coast.current());
        Local::future(move |item: Arc<Item<PerceivedScene>>, t| {
            let state = state.clone();
            async move {
                let seen = item.value().ok_or("nothing was detected")?;
                let next = track(state.current(), *seen);
                let next = kill.compute(VehiclePart::LocalTracker, 20 * MS, next).await?;
                state.computed(t, Some(next));
                Ok(next)
            }
        })
    }
}
// ANCHOR_END: state

impl Operator for Predicting {
    type Input = Item<PerceivedScene>;
    type Output = Prediction;

    fn setup(
        self,
        setup: &mut Setup<Item<PerceivedScene>, Prediction>,
    ) -> Local<Item<PerceivedScene>, Prediction> {
        let kill = self.0.kill;
        let last = keep_last(setup);
        setup.use_substitute(move |_| last.current());
        Local::future(move |item: Arc<Item<PerceivedScene>>, _| async move {
            let prediction = predict(*item.value().ok_or("nothing was tracked")?);
            kill.compute(VehiclePart::LocalPredictor, 15 * MS, prediction).await
        })
    }
}

impl Operator for Planning {
    type Input = Item<Prediction>;
    type Output = PerceivedScene;

    fn setup(
        self,
        setup: &mut Setup<Item<Prediction>, PerceivedScene>,
    ) -> Local<Item<Prediction>, PerceivedScene> {
        let Drive { mode, kill, tracking, .. } = self.0;
        // Plans for what is unlikely are obtained beside the outputs, the likeliest first.
        let plans = SharedState::<Vec<&'static str>>::default();
        let contingencies = plans.clone();
        let handle = move |what: &'static str, _| {
            let network = tracking.clone();
            async move {
                network.round_trip().await;
                Ok::<_, Error>(what)
            }
        };
        let cached = plans.clone();
        let message_handler = move |item: &Item<Prediction>, _: u64| {
            let unlikely = item.value().filter(|_| mode != Mode::Local)?.trajectories[1..].iter();
            let wanted = unlikely.map(|(what, _)| *what);
            let missing = cached.with(|cached| wanted.clone().find(|what| !cached.contains(what)));
            Some((missing?, 1000 * MS))
        };
        let response_handler = move |what| {
            contingencies.with(|plans| plans.push(what));
            Ok(())
        };
        let side = setup.use_side_request(handle, message_handler, response_handler);
        side.name = "contingency".into();
        let last = keep_last(setup);
        setup.use_substitute(move |_| last.current());
        Local::future(move |item: Arc<Item<Prediction>>, _| {
            let plans = plans.clone();
            async move {
                let prediction = item.value().ok_or("nothing was predicted")?;
                // With a plan that was made before it only has to be checked.
                let is_ready = plans.with(|plans| plans.contains(&"crosses"));
                let runtime = if prediction.seen.walker && is_ready { 15 * MS } else { 40 * MS };
                kill.compute(VehiclePart::LocalPlanner, runtime, prediction.seen).await
            }
        })
    }
}

impl Operator for Control {
    type Input = Joined<Order>;
    type Output = Option<PerceivedScene>;

    fn setup(
        self,
        setup: &mut Setup<Joined<Order>, Option<PerceivedScene>>,
    ) -> Local<Joined<Order>, Option<PerceivedScene>> {
        // A safe stop.
        setup.use_substitute(|_| Some(None));
        Local::future(|order: Arc<Joined<Order>>, _| async move {
            tokio::time::sleep(MS).await;
            let now = tokio::time::Instant::now().into_std();
            // A substitute for a plan is the last one, as old as it is.
            let is_fresh =
                |plan: &PerceivedScene| now.saturating_duration_since(plan.captured) <= 1000 * MS;
            Ok(Some(order.set.plan.filter(is_fresh).ok_or("no plan that is fresh")?))
        })
    }
}

/// The last result that was sent, for a substitute.
fn keep_last<I, O: Clone + Send + Sync + 'static>(
    setup: &mut Setup<I, O>,
) -> CarriedState<Option<O>> {
    let last = CarriedState::new(None);
    setup.use_state(&last, |output: &O| Some(output.clone()));
    last
}

fn detect(scene: &Joined<Scene>, accuracy: f64) -> Option<PerceivedScene> {
    let Scene { left, right, .. } = &scene.set;
    let frames = [left, right].into_iter().flatten();
    let cameras = f64::from(u8::from(left.is_some()) + u8::from(right.is_some()));
    let captured = frames.clone().map(|frame| frame.captured).min()?;
    let walker = frames.clone().any(|frame| frame.walker);
    Some(PerceivedScene { captured, accuracy: accuracy * cameras / 2.0, walker, tracked: 0 })
}

fn track(state: Option<PerceivedScene>, seen: PerceivedScene) -> PerceivedScene {
    PerceivedScene { tracked: state.map_or(0, |state| state.tracked) + 1, ..seen }
}

fn predict(seen: PerceivedScene) -> Prediction {
    Prediction { seen, trajectories: [("stays", 0.8), ("crosses", 0.15), ("turns back", 0.05)] }
}

fn ms(ms: f64) -> Duration {
    Duration::from_secs_f64(ms / 1000.0)
}
