//! Causes at work in a step, and the macro that makes the list of all causes.

use std::fmt::Debug;

use super::Effect;
use crate::dynamics::Work;
use crate::dynamics::plant::Plant;
use crate::model::Model;
use crate::space::Space;

/// When the forces are asked for.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Moment {
    /// Time \[s\].
    pub(crate) time_s: f64,
    /// Since the step began \[s\]; 0 at the state that the last step ended in.
    pub(crate) elapsed_s: f64,
    /// Length of the last step \[s\], when this is the first look at the state that it ended in; infinite where a run
    /// begins.
    pub(crate) arrived_s: Option<f64>,
}

/// What a cause does in a step. Each hook does nothing unless the cause has it, and is inlined into the step.
pub(crate) trait Step<S: Space>: Sized + Debug + Clone + Send + Sync {
    /// The cause with these values, laid out for `plant`.
    fn new(effect: &Effect<S::T>, model: &Model<S::T>, plant: &Plant<S>) -> Self;

    /// How many vectors of memory it keeps from step to step, 0 at first.
    fn memory(&self) -> usize {
        0
    }

    /// Adds to the velocity of the water, world axes \[m/s\]; `clock` is by how much a lane's clock is ahead \[s\].
    #[inline(always)]
    fn water(&self, _moment: Moment, _clock: S::T, _plant: &Plant<S>, _velocity: &mut S::Vec) {}

    /// Adds to the mass matrix.
    #[inline(always)]
    fn inertia(&self, _plant: &Plant<S>, _work: &mut Work<S>) {}

    /// Adds to the wrenches on the bodies; velocities are known.
    #[inline(always)]
    fn wrenches(&self, _moment: Moment, _plant: &Plant<S>, _work: &mut Work<S>, _memory: &mut [S::Vec]) {}

    /// Adds to the forces on the degrees of freedom.
    #[inline(always)]
    fn forces(&self, _qpos: &[S::T], _qvel: &[S::T], _force: &mut [S::T]) {}

    /// Adds how fast its force on each degree of freedom falls with the rate and with the coordinate, for implicit steps: about,
    /// where it may be stiff. Exact or not, motions are the same in the limit of short steps.
    #[inline(always)]
    fn slopes(&self, _qpos: &[S::T], _qvel: &[S::T], _damping: &mut [S::T], _stiffness: &mut [S::T]) {}
}

macro_rules! causes {
    (
        model { $($model:ident $Model:ident,)* }
        step { $($step:ident $Step:ident $(+ $alter:ident)?,)* }
        drive { $($drive:ident $Drive:ident,)* }
        picture { $($picture:ident $Picture:ident,)* }
    ) => {
        /// The causes, by name.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        pub enum Cause {
            $(#[doc = concat!("`", stringify!($model), "`")] $Model,)*
            $(#[doc = concat!("`", stringify!($step), "`")] $Step,)*
            $(#[doc = concat!("`", stringify!($drive), "`")] $Drive,)*
            $(#[doc = concat!("`", stringify!($picture), "`")] $Picture,)*
        }

        impl Cause {
            /// All of them.
            pub const ALL: &'static [Self] =
                &[$(Self::$Model,)* $(Self::$Step,)* $(Self::$Drive,)* $(Self::$Picture,)*];

            /// What it says about itself.
            pub fn info(self) -> &'static Info {
                match self {
                    $(Self::$Model => &$model::INFO,)*
                    $(Self::$Step => &$step::INFO,)*
                    $(Self::$Drive => &$drive::INFO,)*
                    $(Self::$Picture => &$picture::INFO,)*
                }
            }

            /// Its name.
            pub fn name(self) -> &'static str {
                self.info().name
            }
        }

        impl std::str::FromStr for Cause {
            type Err = UnknownCause;

            fn from_str(name: &str) -> Result<Self, UnknownCause> {
                Self::ALL.iter().copied().find(|cause| cause.name() == name).ok_or_else(|| UnknownCause {
                    name: name.into(),
                    known: Self::ALL.iter().map(|cause| cause.name()).collect::<Vec<_>>().join(", "),
                })
            }
        }

        /// Lets `effect` change the model's own numbers, if that is its way; whether it is.
        fn alter<T: Scalar>(effect: &Effect<T>, model: &mut Model<T>) -> bool {
            match effect.cause {
                $(Cause::$Model => $model::alter(effect, model),)*
                $($(Cause::$Step => return $step::$alter(effect, model),)?)*
                _ => return false,
            }
            true
        }

        /// The causes of a model that act in a step, laid out for its plant.
        ///
        /// Each is a function of its own, so that models without it neither carry it nor wait for it.
        #[derive(Debug, Clone)]
        pub(crate) struct Terms<S: Space> {
            /// Whether there is any.
            some: bool,
            $($step: Option<$step::Term<S>>,)*
        }

        impl<S: Space> Terms<S> {
            /// Those that `model` carries.
            pub(crate) fn new(model: &Model<S::T>, plant: &crate::dynamics::plant::Plant<S>) -> Self {
                Self {
                    some: false $(|| model.has(Cause::$Step))*,
                    $($step: model.effect(Cause::$Step).map(|effect| $step::Term::new(effect, model, plant)),)*
                }
            }

            /// Whether there is any.
            pub(crate) fn any(&self) -> bool {
                self.some
            }

            /// Room for what they remember.
            pub(crate) fn memory(&self) -> Memory<S> {
                Memory { $($step: vec![
                    <S::Vec as crate::math::Vector<S::T>>::ZERO;
                    self.$step.as_ref().map_or(0, Step::memory)
                ],)* }
            }

            /// Whether any of them remembers.
            pub(crate) fn remember(&self) -> bool {
                false $(|| self.$step.as_ref().is_some_and(|term| term.memory() > 0))*
            }

            /// The velocity of the water at `moment`, world axes \[m/s\].
            #[inline(always)]
            pub(crate) fn water(&self, moment: Moment,
                clock: S::T, plant: &crate::dynamics::plant::Plant<S>) -> S::Vec {
                if self.some { self.water_apart(moment, clock, plant) } else { plant.wind }
            }

            #[inline(never)]
            fn water_apart(&self, moment: Moment,
                clock: S::T, plant: &crate::dynamics::plant::Plant<S>) -> S::Vec {
                let mut velocity = plant.wind;
                $(if let Some(term) = &self.$step {
                    crate::scalar::tuned!(S::T, term.water(moment, clock, plant, &mut velocity));
                })*
                velocity
            }

            /// Adds their inertia to the mass matrix.
            #[inline(always)]
            pub(crate) fn inertia(
                &self,
                plant: &crate::dynamics::plant::Plant<S>,
                work: &mut crate::dynamics::Work<S>,
            ) {
                if self.some {
                    self.inertia_apart(plant, work);
                }
            }

            #[inline(never)]
            fn inertia_apart(
                &self,
                plant: &crate::dynamics::plant::Plant<S>,
                work: &mut crate::dynamics::Work<S>,
            ) {
                $(if let Some(term) = &self.$step {
                        crate::scalar::tuned!(S::T, term.inertia(plant, work));
                    })*
            }

            /// Adds their wrenches on the bodies.
            #[inline(always)]
            pub(crate) fn wrenches(
                &self,
                moment: Moment,
                plant: &crate::dynamics::plant::Plant<S>,
                work: &mut crate::dynamics::Work<S>,
                memory: &mut Memory<S>,
            ) {
                if self.some {
                    self.wrenches_apart(moment, plant, work, memory);
                }
            }

            #[inline(never)]
            fn wrenches_apart(
                &self,
                moment: Moment,
                plant: &crate::dynamics::plant::Plant<S>,
                work: &mut crate::dynamics::Work<S>,
                memory: &mut Memory<S>,
            ) {
                $(if let Some(term) = &self.$step {
                        crate::scalar::tuned!(S::T, term.wrenches(moment, plant, work, &mut memory.$step));
                    })*
            }

            /// Adds their forces on the degrees of freedom.
            #[inline(always)]
            pub(crate) fn forces(&self, qpos: &[S::T], qvel: &[S::T], force: &mut [S::T]) {
                if self.some {
                    self.forces_apart(qpos, qvel, force);
                }
            }

            #[inline(never)]
            fn forces_apart(&self, qpos: &[S::T], qvel: &[S::T], force: &mut [S::T]) {
                $(if let Some(term) = &self.$step {
                        crate::scalar::tuned!(S::T, term.forces(qpos, qvel, force));
                    })*
            }

            /// Adds how fast these fall with the rate and with the coordinate.
            #[inline(always)]
            pub(crate) fn slopes(
                &self,
                qpos: &[S::T],
                qvel: &[S::T],
                damping: &mut [S::T],
                stiffness: &mut [S::T],
            ) {
                if self.some {
                    self.slopes_apart(qpos, qvel, damping, stiffness);
                }
            }

            #[inline(never)]
            fn slopes_apart(
                &self,
                qpos: &[S::T],
                qvel: &[S::T],
                damping: &mut [S::T],
                stiffness: &mut [S::T],
            ) {
                $(if let Some(term) = &self.$step {
                        crate::scalar::tuned!(S::T, term.slopes(qpos, qvel, damping, stiffness));
                    })*
            }
        }

        /// What the causes remember from step to step.
        #[derive(Debug, Clone)]
        pub(crate) struct Memory<S: Space> {
            $($step: Vec<S::Vec>,)*
        }

        /// How many causes change commands.
        const STAGES: usize = [$(stringify!($drive)),*].len();

        /// The causes of a model that change commands, in their order.
        #[derive(Debug, Clone)]
        pub(crate) struct Stages<T> {
            $($drive: Option<$drive::Term<T>>,)*
        }

        impl<T: Scalar> Stages<T> {
            /// Those that `model` carries.
            pub(crate) fn new(model: &Model<T>) -> Self {
                use drive::Stage as _;
                Self { $($drive: model.effect(Cause::$Drive).map($drive::Term::new),)* }
            }

            /// Whether there is none.
            pub(crate) fn is_empty(&self) -> bool {
                true $(&& self.$drive.is_none())*
            }

            /// When the command was given that acts at `time_s`.
            #[inline(always)]
            pub(crate) fn given(&self, mut time_s: T) -> T {
                use drive::Stage as _;
                $(if let Some(stage) = &self.$drive {
                    time_s = stage.given(time_s);
                })*
                time_s
            }

            /// What each stage hands on when the command has stood at `command` for ever.
            pub(crate) fn steady(&self, mut command: T) -> [T; STAGES] {
                use drive::Stage as _;
                let mut states = [T::ZERO; STAGES];
                let mut place = 0;
                $(
                    if let Some(stage) = &self.$drive {
                        command = stage.steady(command);
                    }
                    states[place] = command;
                    place += 1;
                )*
                let _ = place;
                states
            }

            /// Passes one straight piece of the command through all stages, from and to their `states`.
            #[inline(always)]
            pub(crate) fn pass(&self, states: &mut [T; STAGES], piece: drive::Piece<T>) {
                use drive::Stage as _;
                let mut pieces = drive::Pieces::of(piece);
                let mut place = 0;
                $(
                    match &self.$drive {
                        Some(stage) => {
                            let mut out = drive::Pieces::new();
                            for &piece in pieces.as_slice() {
                                stage.pass(&mut states[place], piece, &mut out);
                            }
                            pieces = out;
                        }
                        None => states[place] = pieces.end(),
                    }
                    place += 1;
                )*
                let _ = (place, pieces);
            }
        }

        /// The causes of a model that change what the camera sees, in their order.
        #[derive(Debug, Clone)]
        pub(crate) struct Looks<T> {
            $($picture: Option<$picture::Term<T>>,)*
        }

        impl<T: Scalar> Looks<T> {
            /// Those that `model` carries.
            pub(crate) fn new(model: &Model<T>) -> Self {
                Self { $($picture: model.effect(Cause::$Picture).map($picture::Term::new),)* }
            }

            /// Whether there is none.
            pub(crate) fn is_empty(&self) -> bool {
                true $(&& self.$picture.is_none())*
            }

            /// Whether some of them sees a point at another time than the image's.
            pub(crate) fn shifts(&self) -> bool {
                false $(|| self.$picture.as_ref().is_some_and(Look::shifts))*
            }

            /// By how much later \[s\] than the image's time all of it is seen.
            #[inline(always)]
            pub(crate) fn late(&self) -> T {
                let mut shift = T::ZERO;
                $(if let Some(look) = &self.$picture {
                    shift += look.late();
                })*
                shift
            }

            /// By how much later still \[s\] the point at `at` is seen.
            #[inline(always)]
            pub(crate) fn late_at(&self, at: [T; 3]) -> T {
                let mut shift = T::ZERO;
                $(if let Some(look) = &self.$picture {
                    shift += look.late_at(at);
                })*
                shift
            }

            /// Where the point at `at` seems to be.
            #[inline(always)]
            pub(crate) fn see(&self, mut at: [T; 3]) -> [T; 3] {
                $(if let Some(look) = &self.$picture {
                    at = look.see(at);
                })*
                at
            }
        }
    };
}
