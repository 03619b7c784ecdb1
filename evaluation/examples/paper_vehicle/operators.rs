//! The vehicle's operators. Detection replays recorded results; the others' computations are
//! emulated.

use std::sync::Arc;
use std::time::Duration;

use fuseline_tokio::{
    CarriedState, Commit, Error, Item, Joined, Local, Operator, Setup, SharedState,
};
use tokio::time::Instant;

use super::recording::{Detector, Recording, Seen};
use super::world::{Kill, Network, VehiclePart};

const MS: Duration = Duration::from_millis(1);

/// Selects the results of detection that are used, and when.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Rule {
    /// No operator has a cloud.
    OnBoard,
    /// The larger cloud alone detects.
    CloudAlone,
    /// The first of the three detectors that answers.
    FirstResponse,
    Eager,
    Patient,
    Progressive,
}

/// The state of a drive that all operators know.
#[derive(Clone, Debug)]
pub(crate) struct Drive {
    pub(crate) rule: Rule,
    pub(crate) recording: Arc<Recording>,
    pub(crate) start: Instant,
    pub(crate) kill: Kill,
    /// The networks of the two detectors and the tracker.
    pub(crate) west: Network,
    pub(crate) east: Network,
    pub(crate) tracking: Network,
}

/// The part of the scene that the sensors see at one instant.
#[derive(Clone, Default, Debug)]
pub(crate) struct Scene {
    pub(crate) left: Option<Frame>,
    pub(crate) right: Option<Frame>,
    pub(crate) place: Option<u64>,
}

/// A camera's frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub(crate) number: usize,
    /// True if somebody walks towards the road.
    pub(crate) walker: bool,
}

/// The scene as it was detected, tracked or planned.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct PerceivedScene {
    pub(crate) seen: Seen,
    pub(crate) walker: bool,
    /// The number of frames in a row in which it was tracked.
    pub(crate) tracked: u32,
}

/// A prediction of what may happen.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Prediction {
    scene: PerceivedScene,
    /// Trajectories of the walker, each with its probability.
    trajectories: [(&'static str, f64); 3],
}

/// The order that control carries out.
#[derive(Clone, Default, Debug)]
pub(crate) struct Order {
    pub(crate) plan: Option<PerceivedScene>,
}

pub(crate) struct Detection(pub(crate) Drive);
pub(crate) struct Tracking(pub(crate) Drive);
pub(crate) struct Predicting(pub(crate) Drive);
pub(crate) struct Planning(pub(crate) Drive);
pub(crate) struct Control(pub(crate) Drive);

impl Rule {
    pub(crate) const ALL: [Self; 6] = [
        Self::OnBoard,
        Self::CloudAlone,
        Self::FirstResponse,
        Self::Eager,
        Self::Patient,
        Self::Progressive,
    ];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::OnBoard => "on board",
            Self::CloudAlone => "cloud alone",
            Self::FirstResponse => "first response",
            Self::Eager => "eager",
            Self::Patient => "patient",
            Self::Progressive => "progressive",
        }
    }

    /// Returns the commit rule of detection. The other operators are eager.
    pub(crate) const fn commit(self) -> Commit {
        match self {
            Self::OnBoard | Self::CloudAlone | Self::FirstResponse | Self::Eager => Commit::Eager,
            Self::Patient => Commit::Patient,
            Self::Progressive => Commit::Progressive,
        }
    }

    /// Returns the clouds of detection.
    const fn clouds(self) -> &'static [Detector] {
        match self {
            Self::OnBoard | Self::FirstResponse => &[],
            Self::CloudAlone => &[Detector::East],
            Self::Eager | Self::Patient | Self::Progressive => &[Detector::West, Detector::East],
        }
    }
}

impl Drive {
    /// Returns a detector's result for a scene, after the runtime that was recorded.
    async fn detect(
        &self,
        by: Detector,
        scene: Option<PerceivedScene>,
    ) -> Result<PerceivedScene, Error> {
        let mut scene = scene.ok_or("no camera")?;
        scene.seen.by = by;
        let part = match by {
            Detector::Local => VehiclePart::LocalDetector,
            Detector::West => VehiclePart::WestDetector,
            Detector::East => VehiclePart::EastDetector,
        };
        match by {
            Detector::Local => {}
            Detector::West => self.west.clone().round_trip().await,
            Detector::East => self.east.clone().round_trip().await,
        }
        self.kill.compute(part, self.recording.runtime(by, scene.seen.frame), scene).await
    }

    /// Returns the result of the first detector that answers.
    async fn detect_first(&self, scene: Option<PerceivedScene>) -> Result<PerceivedScene, Error> {
        tokio::select! {
            biased;
            detected = self.detect(Detector::Local, scene) => detected,
            detected = self.detect(Detector::West, scene) => detected,
            detected = self.detect(Detector::East, scene) => detected,
        }
    }
}

impl Operator for Detection {
    type Input = Joined<Scene>;
    type Output = PerceivedScene;

    fn setup(
        self,
        setup: &mut Setup<Joined<Scene>, PerceivedScene>,
    ) -> Local<Joined<Scene>, PerceivedScene> {
        let drive = self.0;
        for (priority, by) in (1..).zip(drive.rule.clouds()) {
            let cloud = drive.clone();
            let handle = move |scene, _| {
                let cloud = cloud.clone();
                async move { cloud.detect(*by, Some(scene)).await }
            };
            let message_handler = |scene: &Joined<Scene>, _| Some((see(scene)?, 400 * MS));
            setup.use_cloud(handle, message_handler, Ok, priority).name = by.name().into();
        }
        // The substitute is the last boxes, although they are older.
        let last = keep_last(setup);
        setup.use_substitute(move |_| last.current());
        let mut local = Local::futures(4, move |scene: Arc<Joined<Scene>>, _| {
            let drive = drive.clone();
            async move {
                match drive.rule {
                    Rule::CloudAlone => Err("no detection on board".into()),
                    Rule::FirstResponse => drive.detect_first(see(&scene)).await,
                    _ => drive.detect(Detector::Local, see(&scene)).await,
                }
            }
        });
        local.waiting = Some(1);
        local
    }
}

/// Tracking sends its state along with each request. It continues with the cloud's state if the
/// cloud's result is sent.
impl Operator for Tracking {
    type Input = Item<PerceivedScene>;
    type Output = PerceivedScene;

    fn setup(
        self,
        setup: &mut Setup<Item<PerceivedScene>, PerceivedScene>,
    ) -> Local<Item<PerceivedScene>, PerceivedScene> {
        let Drive { rule, kill, tracking, .. } = self.0;
        let state = CarriedState::<Option<PerceivedScene>>::new(None);
        setup.use_state(&state, |seen| Some(*seen));
        let along = state.clone();
        let handle = move |next: PerceivedScene, _| {
            let network = tracking.clone();
            async move {
                network.round_trip().await;
                kill.compute(VehiclePart::CloudTracker, 6 * MS, next).await
            }
        };
        // Requests are sent only while there is somebody to track.
        let message_handler = move |item: &Item<PerceivedScene>, _| {
            let seen = item.value().filter(|seen| rule != Rule::OnBoard && seen.walker)?;
            Some((track(along.current(), *seen), 60 * MS))
        };
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
            kill.compute(VehiclePart::LocalPredictor, 16 * MS, prediction).await
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
        let Drive { rule, kill, tracking, .. } = self.0;
        // Plans for unlikely events are requested beside the outputs, the likeliest event first.
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
            let unlikely = item.value().filter(|_| rule != Rule::OnBoard)?.trajectories[1..].iter();
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
                // A plan that was made before only has to be checked, which is faster.
                let is_ready = plans.with(|plans| plans.contains(&"crosses"));
                let runtime = if prediction.scene.walker && is_ready { 16 * MS } else { 40 * MS };
                kill.compute(VehiclePart::LocalPlanner, runtime, prediction.scene).await
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
        let start = self.0.start;
        // The substitute is a safe stop.
        setup.use_substitute(|_| Some(None));
        Local::future(move |order: Arc<Joined<Order>>, _| async move {
            tokio::time::sleep(MS).await;
            // A substitute for a plan is the last plan, however old it is.
            let is_fresh = |plan: &PerceivedScene| {
                start.elapsed() <= Recording::captured(plan.seen.frame) + 1000 * MS
            };
            Ok(Some(order.set.plan.filter(is_fresh).ok_or("no plan that is fresh")?))
        })
    }
}

/// Keeps the last result that was sent, for use as a substitute.
fn keep_last<I, O: Clone + Send + Sync + 'static>(
    setup: &mut Setup<I, O>,
) -> CarriedState<Option<O>> {
    let last = CarriedState::new(None);
    setup.use_state(&last, |output: &O| Some(output.clone()));
    last
}

/// Returns the frames that the cameras saw. A detector then finds out who is there.
fn see(scene: &Joined<Scene>) -> Option<PerceivedScene> {
    let Scene { left, right, .. } = scene.set;
    let frames = || [left, right].into_iter().flatten();
    let frame = frames().map(|frame| frame.number).min()?;
    let (left, right) = (left.is_some(), right.is_some());
    let seen = Seen { frame, by: Detector::Local, left, right };
    Some(PerceivedScene { seen, walker: frames().any(|frame| frame.walker), tracked: 0 })
}

fn track(state: Option<PerceivedScene>, scene: PerceivedScene) -> PerceivedScene {
    PerceivedScene { tracked: state.map_or(0, |state| state.tracked) + 1, ..scene }
}

fn predict(scene: PerceivedScene) -> Prediction {
    Prediction { scene, trajectories: [("stays", 0.8), ("crosses", 0.15), ("turns back", 0.05)] }
}
