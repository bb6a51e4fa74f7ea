//! The messages of a log from the moments of a city, for ends that pass them on as they are.

use super::decision_sampler::DecisionSampler;
use super::plan_sampler::PlanSampler;
use super::{Inputs, Moment, MomentKind};
use city3d_logbook::record::LogTopic;
use city3d_logbook::record::message::{
    encode_decisions, encode_event, encode_network, encode_plans, encode_tick, nanoseconds,
};

/// Encodes what a moment adds to a log, but its snapshot.
#[derive(Debug, Default)]
pub struct LogMessages {
    decisions: DecisionSampler,
    plans: PlanSampler,
}

/// A message among [`EncodedMessages`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EncodedMessage {
    /// Its topic.
    pub topic: LogTopic,
    /// Simulated time, nanoseconds.
    pub stamp_ns: u64,
    length: usize,
}

/// Messages in CDR, one behind another.
#[derive(Clone, Debug, Default)]
pub struct EncodedMessages {
    messages: Vec<EncodedMessage>,
    bytes: Vec<u8>,
}

impl EncodedMessages {
    /// The messages with their bytes, in order.
    pub fn iter(&self) -> impl Iterator<Item = (EncodedMessage, &[u8])> {
        let mut rest = &self.bytes[..];
        self.messages.iter().map(move |message| {
            let (bytes, behind) = rest.split_at(message.length);
            rest = behind;
            (*message, bytes)
        })
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.messages.is_empty()
    }

    /// Bytes of all messages together.
    pub fn size(&self) -> usize {
        self.bytes.len()
    }

    /// Appends a message with a function that appends its bytes.
    fn push(&mut self, topic: LogTopic, time_s: f64, encode: impl FnOnce(Vec<u8>) -> Vec<u8>) {
        let start = self.bytes.len();
        self.bytes = encode(std::mem::take(&mut self.bytes));
        let length = self.bytes.len() - start;
        self.messages.push(EncodedMessage { topic, stamp_ns: nanoseconds(time_s), length });
    }

    /// Appends a message that was encoded in a buffer of its own.
    fn push_whole(&mut self, topic: LogTopic, time_s: f64, message: &[u8]) {
        self.push(topic, time_s, |mut bytes| {
            bytes.extend_from_slice(message);
            bytes
        });
    }
}

impl LogMessages {
    /// The messages of a moment on the topics that are wanted, in the order of a log. Events are those of the city itself,
    /// without the merges that a log adds. A command that cannot be encoded is left out.
    pub fn of_moment(
        &mut self,
        moment: &Moment<'_>,
        is_wanted: impl Fn(LogTopic) -> bool,
    ) -> EncodedMessages {
        let mut told = EncodedMessages::default();
        inputs(moment, &is_wanted, &mut told);
        if moment.kind != MomentKind::Tick {
            return told;
        }
        let (tick, time_s) = (moment.snapshot.tick, moment.snapshot.time_s);
        if is_wanted(LogTopic::Decisions) {
            let due = self.decisions.of_moment(moment);
            if !due.is_empty() {
                told.push(LogTopic::Decisions, time_s, |bytes| encode_decisions(tick, time_s, &due, bytes));
            }
        }
        if is_wanted(LogTopic::Plans) {
            let due = self.plans.of_moment(moment);
            if !due.is_empty() {
                told.push(LogTopic::Plans, time_s, |bytes| encode_plans(tick, time_s, &due, bytes));
            }
        }
        if is_wanted(LogTopic::Event) {
            for event in &moment.snapshot.events {
                told.push_whole(LogTopic::Event, event.time_s, &encode_event(event, Vec::new()));
            }
        }
        if is_wanted(LogTopic::Tick) {
            let message = encode_tick(tick, moment.snapshot.state_hash, Vec::new());
            told.push_whole(LogTopic::Tick, time_s, &message);
        }
        told
    }
}

/// The commands that led to a moment.
fn inputs(moment: &Moment<'_>, is_wanted: &impl Fn(LogTopic) -> bool, told: &mut EncodedMessages) {
    let (tick, time_s) = moment.from;
    match moment.inputs {
        Inputs::None => {}
        Inputs::Commands(commands) => {
            for command in commands {
                if let Some(topic) = LogTopic::of_command(command).filter(|topic| is_wanted(*topic)) {
                    told.push(topic, time_s, |mut bytes| {
                        LogTopic::encode(tick, command, &mut bytes);
                        bytes
                    });
                }
            }
        }
        Inputs::Network(applied, labels) if is_wanted(LogTopic::Network) => {
            for command in applied.iter().filter_map(|applied| labels.logged(tick, applied).ok()) {
                told.push_whole(LogTopic::Network, time_s, &encode_network(&command, Vec::new()));
            }
        }
        Inputs::Network(..) => {}
    }
}
