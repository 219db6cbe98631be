//! The macro that makes of the list of causes what stands in a model, in a step, between command and drive, and in the camera.

macro_rules! causes {
    (
        model { $($model:ident in $model_in:ident,)* }
        step { $($step:ident in $step_in:ident $(+ $alter:ident)?,)* }
        drive { $($drive:ident in $drive_in:ident $(+ $start:ident among $starts:ident)?,)* }
        picture { $($picture:ident in $picture_in:ident,)* }
    ) => {
        impl Cause {
            /// All built-in causes, in the order of the list.
            pub const ALL: &'static [Self] = &[
                $(Self::new(&$model_in::$model::INFO),)*
                $(Self::new(&$step_in::$step::INFO),)*
                $(Self::new(&$drive_in::$drive::INFO),)*
                $(Self::new(&$picture_in::$picture::INFO),)*
            ];
        }

        /// Lets a cause change the model's own numbers, if that is its way; whether it is.
        fn alter<T: Scalar>(values: &CauseValues<T>, model: &mut Model<T>) -> bool {
            let name = values.cause().name();
            $(if name == $model_in::$model::INFO.name {
                $model_in::$model::alter(values, model);
                return true;
            })*
            $($(if name == $step_in::$step::INFO.name {
                return $step_in::$step::$alter(values, model);
            })?)*
            false
        }

        impl Cause {
            /// Names after the cause's, and values, of hidden numbers at which it begins to explain how driven joints followed their
            /// commands; none where that says nothing about it.
            pub fn start(self, followings: &[Following<'_>]) -> Vec<(&'static str, f64)> {
                $($(if self.name() == $drive_in::$drive::INFO.name {
                    return $drive_in::$drive::$start(followings);
                })?)*
                Vec::new()
            }

            /// Among how many beginnings that differ [`Cause::start`] chooses in runs of `span_s` \[s\] in all: so many chances of explaining
            /// mere noise.
            pub fn starts(self, span_s: f64) -> f64 {
                $($(if self.name() == $drive_in::$drive::INFO.name {
                    return $drive_in::$drive::$starts(span_s);
                })?)*
                1.0
            }
        }

        /// The causes of a model that act in a step, laid out for its plant.
        ///
        /// Each is a function of its own, so that models without it neither carry it nor wait for it.
        #[derive(Debug, Clone)]
        pub(crate) struct Terms<S: Space> {
            /// Whether there is any.
            some: bool,
            /// Those that somebody wrote down.
            pub(crate) own: Option<Box<own::Acting<S>>>,
            $($step: Option<$step_in::$step::Term<S>>,)*
        }

        impl<S: Space> Terms<S> {
            /// Those that `model` carries.
            pub(crate) fn new(model: &Model<S::T>, plant: &Plant<S>) -> Self {
                Self {
                    some: false $(|| model.has(Cause::new(&$step_in::$step::INFO)))*,
                    own: own::Acting::new(model, plant),
                    $($step: model
                        .carried(Cause::new(&$step_in::$step::INFO))
                        .map(|values| $step_in::$step::Term::new(values, model, plant)),)*
                }
            }

            /// Room for what they remember.
            pub(crate) fn memory(&self) -> Memory<S> {
                Memory { $($step: vec![
                    <S::Vec as Vector<S::T>>::ZERO;
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
                clock: S::T, plant: &Plant<S>) -> S::Vec {
                if self.some { self.water_apart(moment, clock, plant) } else { plant.wind }
            }

            #[inline(never)]
            fn water_apart(&self, moment: Moment,
                clock: S::T, plant: &Plant<S>) -> S::Vec {
                let mut velocity = plant.wind;
                $(if let Some(term) = &self.$step {
                    tuned!(S::T, term.water(moment, clock, plant, &mut velocity));
                })*
                velocity
            }

            /// Adds their inertia to the mass matrix.
            #[inline(always)]
            pub(crate) fn inertia(
                &self,
                plant: &Plant<S>,
                work: &mut Work<S>,
            ) {
                if self.some {
                    self.inertia_apart(plant, work);
                }
            }

            #[inline(never)]
            fn inertia_apart(
                &self,
                plant: &Plant<S>,
                work: &mut Work<S>,
            ) {
                $(if let Some(term) = &self.$step {
                        tuned!(S::T, term.inertia(plant, work));
                    })*
            }

            /// Adds their wrenches on the bodies.
            #[inline(always)]
            pub(crate) fn wrenches(
                &self,
                moment: Moment,
                plant: &Plant<S>,
                work: &mut Work<S>,
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
                plant: &Plant<S>,
                work: &mut Work<S>,
                memory: &mut Memory<S>,
            ) {
                $(if let Some(term) = &self.$step {
                        tuned!(S::T, term.wrenches(moment, plant, work, &mut memory.$step));
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
                        tuned!(S::T, term.forces(qpos, qvel, force));
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
                        tuned!(S::T, term.slopes(qpos, qvel, damping, stiffness));
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
            $($drive: Option<$drive_in::$drive::Term<T>>,)*
        }

        impl<T: Scalar> Stages<T> {
            /// Those that `model` carries.
            pub(crate) fn new(model: &Model<T>) -> Self {
                Self { $($drive: model
                    .carried(Cause::new(&$drive_in::$drive::INFO))
                    .map($drive_in::$drive::Term::new),)* }
            }

            /// Whether there is none.
            pub(crate) fn is_empty(&self) -> bool {
                true $(&& self.$drive.is_none())*
            }

            /// When the command was given that acts at `time_s`.
            #[inline(always)]
            pub(crate) fn given(&self, mut time_s: T) -> T {
                $(if let Some(stage) = &self.$drive {
                    time_s = stage.given(time_s);
                })*
                time_s
            }

            /// Longest piece that they can be handed \[s\].
            pub(crate) fn longest_piece_s(&self) -> f64 {
                f64::INFINITY$(.min(self.$drive.as_ref().map_or(f64::INFINITY, Stage::longest_piece_s)))*
            }

            /// Longest step that follows what they hand on \[s\].
            pub(crate) fn longest_step_s(&self) -> f64 {
                f64::INFINITY$(.min(self.$drive.as_ref().map_or(f64::INFINITY, Stage::longest_step_s)))*
            }

            /// State of each stage after a constant `command`.
            pub(crate) fn steady(&self, mut command: T) -> [StageState<T>; STAGES] {
                let mut states = [StageState::steady(T::ZERO); STAGES];
                let mut place = 0;
                $(
                    if let Some(stage) = &self.$drive {
                        command = stage.steady(command);
                    }
                    states[place] = StageState::steady(command);
                    place += 1;
                )*
                let _ = place;
                states
            }

            /// Passes one straight piece of the command through all stages, from and to their `states`.
            #[inline(always)]
            pub(crate) fn pass(&self, states: &mut [StageState<T>; STAGES], piece: Piece<T>) {
                let mut pieces = Pieces::of(piece);
                let mut place = 0;
                $(
                    match &self.$drive {
                        Some(stage) => {
                            let mut out = Pieces::new();
                            for &piece in pieces.as_slice() {
                                stage.pass(&mut states[place], piece, &mut out);
                            }
                            pieces = out;
                        }
                        None => states[place] = StageState::steady(pieces.end()),
                    }
                    place += 1;
                )*
                let _ = (place, pieces);
            }
        }

        /// The causes of a model that change what the camera sees, in their order.
        #[derive(Debug, Clone)]
        pub(crate) struct Looks<T> {
            $($picture: Option<$picture_in::$picture::Term<T>>,)*
        }

        impl<T: Scalar> Looks<T> {
            /// Those that `model` carries.
            pub(crate) fn new(model: &Model<T>) -> Self {
                Self { $($picture: model
                    .carried(Cause::new(&$picture_in::$picture::INFO))
                    .map($picture_in::$picture::Term::new),)* }
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
