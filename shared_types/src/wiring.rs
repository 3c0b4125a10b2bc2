//! Wiring table: the publisher and the consumers of each topic, stated in one place only.
//!
//! The table at the end of this file determines the ports, the schedule's edges, the in-process wiring, the recorder's
//! channels and the diagram in the documentation.

use std::ops::Range;

use crate::ports::{Input, InputView, Inputs, Output, OutputSlot, Outputs, SampleKind};
use crate::sample::{Header, Member, Sample, layout_hash, msg_definition};
use crate::samples::{
    BaroAltitude, BaselineInnovations, ControlAdaptation, ControlCommand, ControlErrors, ControlTelemetry,
    GnssBaseline, GnssFix, ImuSample, MagField, MocapPose, NavigationInnovations, PathReference,
    PoseInnovations, RcFrame, RunEvent, VehicleState, VehicleTruth,
};

/// Set of external services: for each service in the order of the wiring table, whether a program replaces it.
pub type ExternalServices = [bool; ServiceId::ALL.len()];

/// Input of a service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InputSpec {
    /// Name of the input in the step logic.
    pub name: &'static str,
    /// Topic of its samples.
    pub topic: Topic,
    /// Default transport latency, base ticks.
    pub default_latency_ticks: u64,
}

/// Output of a service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutputSpec {
    /// Name of the output in the step logic.
    pub name: &'static str,
    /// Topic of its samples.
    pub topic: Topic,
}

/// Sample that travels on a topic.
pub trait Published: Sample {
    /// The topic.
    const TOPIC: Topic;
}

/// Operation on the sample type of a topic, see [`Topic::dispatch`].
pub trait TopicVisitor {
    /// Result of the operation.
    type Result;

    /// Executes the operation for the sample type `T`.
    fn visit<T: Published>(self) -> Self::Result;
}

impl Topic {
    /// Returns the position in [`Topic::ALL`], which is also the order of topics within a tick of a log.
    #[must_use]
    #[inline]
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Returns the name of the sample type on the wire and in logs.
    #[must_use]
    pub fn msg_name(self) -> &'static str {
        struct Name;
        impl TopicVisitor for Name {
            type Result = &'static str;
            fn visit<T: Published>(self) -> &'static str {
                T::MSG_NAME
            }
        }
        self.dispatch(Name)
    }

    /// Returns the message definition of the sample type, as logs carry it.
    #[must_use]
    pub fn msg_definition(self) -> String {
        struct Definition;
        impl TopicVisitor for Definition {
            type Result = String;
            fn visit<T: Published>(self) -> String {
                msg_definition::<T>()
            }
        }
        self.dispatch(Definition)
    }

    /// Returns the layout hash of the sample type.
    #[must_use]
    pub fn layout_hash(self) -> String {
        struct Hash;
        impl TopicVisitor for Hash {
            type Result = String;
            fn visit<T: Published>(self) -> String {
                layout_hash::<T>()
            }
        }
        self.dispatch(Hash)
    }

    /// Returns the members of the sample type.
    #[must_use]
    pub fn members(self) -> Vec<Member> {
        struct Members;
        impl TopicVisitor for Members {
            type Result = Vec<Member>;
            fn visit<T: Published>(self) -> Vec<Member> {
                T::members()
            }
        }
        self.dispatch(Members)
    }

    /// Returns the bytes of the floating-point numbers of a member, given as `name` for all of them or `name.index` for
    /// one.
    #[must_use]
    pub fn find_numbers(self, field: &str) -> Option<Range<usize>> {
        let (name, index) = match field.split_once('.') {
            None => (field, None),
            Some((name, index)) => (name, Some(index.parse().ok()?)),
        };
        let mut members = self.members().into_iter();
        members.find(|member| member.name == name)?.numbers(index)
    }

    /// Returns the topic of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|topic| topic.name() == name)
    }

    /// Returns the service that publishes the topic; `None` for topics of the orchestrator.
    #[must_use]
    pub fn publisher(self) -> Option<ServiceId> {
        ServiceId::ALL
            .into_iter()
            .find(|service| service.outputs().iter().any(|output| output.topic == self))
    }

    /// Returns whether the topic is one of flight outdoors: of a sensor or of navigation. Only flights with sensors have it.
    #[must_use]
    #[inline]
    pub const fn is_of_flight_outdoors(self) -> bool {
        matches!(
            self,
            Self::ImuSample
                | Self::GnssFix
                | Self::BaroAltitude
                | Self::MagField
                | Self::NavigationInnovations
                | Self::PoseInnovations
                | Self::GnssBaseline
                | Self::BaselineInnovations
        )
    }

    /// Returns the services that consume the topic, with the position of the input in each.
    pub fn consumers(self) -> impl Iterator<Item = (ServiceId, usize)> {
        ServiceId::ALL.into_iter().flat_map(move |service| {
            let inputs = service.inputs().iter().enumerate();
            inputs
                .filter(move |(_, input)| input.topic == self)
                .map(move |(index, _)| (service, index))
        })
    }
}

impl ServiceId {
    /// Returns the position in [`ServiceId::ALL`].
    #[must_use]
    #[inline]
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Returns whether the service simulates the vehicle and its surroundings, whose time never stops.
    #[must_use]
    #[inline]
    pub const fn is_the_world(self) -> bool {
        matches!(self, Self::Plant)
    }

    /// Returns the service of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|service| service.name() == name)
    }
}

impl std::fmt::Display for Topic {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.pad(self.name())
    }
}

impl serde::Serialize for ServiceId {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl<'de> serde::Deserialize<'de> for ServiceId {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = <std::borrow::Cow<'_, str>>::deserialize(deserializer)?;
        let unknown = || serde::de::Error::custom(format!("there is no service `{name}`"));
        Self::from_name(&name).ok_or_else(unknown)
    }
}

impl std::fmt::Display for ServiceId {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.pad(self.name())
    }
}

macro_rules! wiring {
    (
        dollar $d:tt
        topics {$(
            $(#[doc = $topic_doc:literal])*
            $topic:ident = $topic_name:literal;
        )+}
        services {$(
            $(#[doc = $service_doc:literal])*
            $service:ident = $name:ident {
                $inputs:ident {$($input:ident: $input_topic:ident $(after $latency:literal)?),* $(,)?}
                $outputs:ident {$($output:ident: $output_topic:ident),* $(,)?}
            }
        )+}
    ) => {
        /// A topic; each has a sample type of the same name.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        pub enum Topic {$(
            $(#[doc = $topic_doc])*
            $topic,
        )+}

        impl Topic {
            /// All topics, in the order in which a log holds the samples of one tick.
            pub const ALL: [Self; [$(Self::$topic),+].len()] = [$(Self::$topic),+];

            /// Returns the name on the wire and in logs.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {$(Self::$topic => $topic_name,)+}
            }

            /// Returns the properties by which hosts move samples of this topic as bytes.
            #[must_use]
            #[inline]
            pub const fn kind(self) -> &'static SampleKind {
                const KINDS: [SampleKind; Topic::ALL.len()] = [$(SampleKind::of::<$topic>()),+];
                // Hosts find the header of a sample without its type.
                const { $(assert!(std::mem::offset_of!($topic, header) == 0);)+ }
                &KINDS[self.index()]
            }

            /// Executes an operation on the topic's sample type.
            pub fn dispatch<V: TopicVisitor>(self, visitor: V) -> V::Result {
                match self {$(Self::$topic => visitor.visit::<$topic>(),)+}
            }
        }

        $(impl Published for $topic {
            const TOPIC: Topic = Topic::$topic;
        }

        impl Sample for $topic {
            #[inline]
            fn header(&self) -> &Header {
                &self.header
            }

            #[inline]
            fn header_mut(&mut self) -> &mut Header {
                &mut self.header
            }
        })+

        /// A service of the flight.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        pub enum ServiceId {$(
            $(#[doc = $service_doc])*
            $service,
        )+}

        impl ServiceId {
            /// All services, in the order of the ring.
            pub const ALL: [Self; [$(Self::$service),+].len()] = [$(Self::$service),+];

            /// Returns the name in scenarios, in reports and on the command line.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {$(Self::$service => stringify!($name),)+}
            }

            /// Returns the inputs of the service.
            #[must_use]
            pub const fn inputs(self) -> &'static [InputSpec] {
                match self {$(Self::$service => &[$(InputSpec {
                    name: stringify!($input),
                    topic: Topic::$input_topic,
                    default_latency_ticks: 0 $(+ $latency)?,
                }),*],)+}
            }

            /// Returns the outputs of the service.
            #[must_use]
            pub const fn outputs(self) -> &'static [OutputSpec] {
                match self {$(Self::$service => &[$(OutputSpec {
                    name: stringify!($output),
                    topic: Topic::$output_topic,
                }),*],)+}
            }
        }

        /// Passes all services to a macro, `name: Service` each: for tables with a field per service.
        #[macro_export]
        macro_rules! with_services {
            ($d callback:ident) => {
                $d callback! {$($name: $service),+}
            };
        }

        $(
            #[doc = concat!("Inputs of the service `", stringify!($name), "`.")]
            #[derive(Debug)]
            pub struct $inputs<'a> {$(
                #[doc = concat!("Newest sample of `", stringify!($input_topic), "`.")]
                pub $input: Input<'a, $input_topic>,
            )*}

            impl<'a> Inputs<'a> for $inputs<'a> {
                #[inline]
                fn from_views(views: &[InputView<'a>]) -> Self {
                    let mut views = views.iter().copied();
                    Self {$($input: Input::from_view(views.next().expect("one view an input")),)*}
                }
            }

            #[doc = concat!("Outputs of the service `", stringify!($name), "`.")]
            #[derive(Debug)]
            pub struct $outputs<'a> {$(
                #[doc = concat!("Place for a sample of `", stringify!($output_topic), "`.")]
                pub $output: Output<'a, $output_topic>,
            )*}

            impl<'a> Outputs<'a> for $outputs<'a> {
                #[inline]
                fn from_slots(slots: &'a mut [OutputSlot<'_>]) -> Self {
                    let mut slots = slots.iter_mut();
                    Self {$($output: Output::from_slot(slots.next().expect("one slot an output")),)*}
                }
            }
        )+
    };
}

wiring! {
    dollar $
    topics {
        /// The plant's true state; for the log, never for a controller.
        VehicleTruth = "vehicle/truth";
        /// The captures of the cameras.
        MocapPose = "mocap/pose";
        /// The estimated state.
        VehicleState = "vehicle/state";
        /// The desired place of the vehicle on the path.
        PathReference = "path/reference";
        /// The command of the controller.
        ControlCommand = "control/command";
        /// The controller's estimates, telemetry.
        ControlAdaptation = "control/adaptation";
        /// The controller's errors, telemetry.
        ControlErrors = "control/errors";
        /// The frames of the radio link.
        RcFrame = "rc/frame";
        /// The events that the scenario schedules, written by the orchestrator.
        RunEvent = "run/events";
        /// Named numbers of a controller that is not Gerono's own; only where the scenario names them.
        ControlTelemetry = "control/telemetry";
        /// The samples of the inertial measurement unit; as the next four, only where the scenario states sensors.
        ImuSample = "imu/sample";
        /// The fixes of the satellite receiver.
        GnssFix = "gnss/fix";
        /// The altitudes of the barometer.
        BaroAltitude = "baro/altitude";
        /// The fields of the magnetometer.
        MagField = "mag/field";
        /// The innovations of inertial navigation; all zero without it.
        NavigationInnovations = "navigation/innovations";
        /// The innovations of the poses that inertial navigation fuses; only where the scenario lets it, or states two antennas: then
        /// all zero without poses.
        PoseInnovations = "navigation/poses";
        /// The baselines of two antennas; as the next, only where inertial navigation is told of them.
        GnssBaseline = "gnss/baseline";
        /// The innovations of these baselines.
        BaselineInnovations = "navigation/baseline";
    }
    services {
        /// Rigid body, actuators, disturbances and the simulated cameras and sensors.
        Plant = plant {
            PlantInputs { frame: RcFrame after 1 }
            PlantOutputs {
                truth: VehicleTruth, pose: MocapPose, imu: ImuSample, fix: GnssFix, altitude: BaroAltitude,
                field: MagField, baseline: GnssBaseline
            }
        }
        /// Motion-capture feed and state estimator.
        Estimator = estimator {
            EstimatorInputs {
                pose: MocapPose, frame: RcFrame after 1, imu: ImuSample, fix: GnssFix, altitude: BaroAltitude,
                field: MagField, baseline: GnssBaseline
            }
            EstimatorOutputs {
                state: VehicleState, innovations: NavigationInnovations, poses: PoseInnovations,
                baselines: BaselineInnovations
            }
        }
        /// The path and its timing law.
        PathGenerator = path_generator {
            PathGeneratorInputs { state: VehicleState, frame: RcFrame after 1 }
            PathGeneratorOutputs { reference: PathReference }
        }
        /// The adaptive control law.
        Controller = controller {
            ControllerInputs { state: VehicleState, reference: PathReference }
            ControllerOutputs {
                command: ControlCommand, adaptation: ControlAdaptation, errors: ControlErrors,
                telemetry: ControlTelemetry
            }
        }
        /// The radio link's transmitter.
        RcOutput = rc_output {
            RcOutputInputs { command: ControlCommand, state: VehicleState }
            RcOutputOutputs { frame: RcFrame }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_found_again() {
        for topic in Topic::ALL {
            assert_eq!(Topic::from_name(topic.name()), Some(topic));
        }
        for service in ServiceId::ALL {
            assert_eq!(ServiceId::from_name(service.name()), Some(service));
        }
        assert_eq!(Topic::from_name("no/such"), None);
    }

    #[test]
    fn every_topic_but_the_orchestrators_own_has_one_publisher() {
        for topic in Topic::ALL {
            let outputs = ServiceId::ALL.into_iter().flat_map(ServiceId::outputs);
            let publishers = outputs.filter(|output| output.topic == topic).count();
            assert_eq!(publishers, usize::from(topic != Topic::RunEvent), "{topic}");
        }
    }

    #[test]
    fn the_truth_is_consumed_by_no_service() {
        assert_eq!(Topic::VehicleTruth.consumers().count(), 0);
    }

    #[test]
    fn an_unused_record_name_is_not_a_topic_name() {
        assert!(
            Topic::ALL
                .iter()
                .all(|topic| topic.msg_name().starts_with("gerono_msgs/msg/"))
        );
    }
}
