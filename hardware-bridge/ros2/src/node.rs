//! A participant in a ROS 2 domain, its publishers and its subscriptions.
//!
//! Participants find each other by multicast, and on one computer by datagrams to the loopback address, which need no
//! multicast. Topics have the names and types that ROS 2 gives them in DDS ([`robot_ros2_messages::names`]). The node does
//! not take part in the graph of ROS 2 nodes: `ros2 topic` lists its topics, `ros2 node` does not list it.

use std::marker::PhantomData;
use std::net::{IpAddr, UdpSocket};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use bytes::Bytes;
use robot_ros2_messages::cdr::{ByteOrder, HEADER_SIZE};
use robot_ros2_messages::names::{dds_topic, dds_type};
use robot_ros2_messages::{CdrError, CdrReader, Message};
use rustdds::dds::adapters::no_key::{Decode, DefaultDecoder, DeserializerAdapter, SerializerAdapter};
use rustdds::no_key::{DataWriter, SimpleDataReader};
use rustdds::policy::{Durability, History, Reliability};
use rustdds::{
    DomainParticipant, DomainParticipantBuilder, QosPolicies, QosPolicyBuilder, RTPSEntity, RepresentationIdentifier,
    TopicKind,
};

use crate::error::Ros2Error;

/// Largest number of a domain: the ports of higher ones do not exist.
pub const MAX_DOMAIN: u16 = 232;
/// Polling interval while a message or a subscriber is awaited.
const POLL_INTERVAL: Duration = Duration::from_millis(2);

/// Quality of service of a topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum QosProfile {
    /// Lost messages are sent again; the last 10 are kept. It fits subscribers of either reliability.
    Reliable,
    /// Lost messages are lost; the last 5 are kept. As a subscriber it fits publishers of either reliability.
    BestEffort,
    /// Reliable, and the last message is kept for subscribers that come later (transient local).
    Latched,
}

impl QosProfile {
    fn policies(self) -> QosPolicies {
        // A publisher never waits for a slow subscriber.
        let reliable = Reliability::Reliable { max_blocking_time: rustdds::Duration::ZERO };
        let (reliability, durability, depth) = match self {
            Self::Reliable => (reliable, Durability::Volatile, 10),
            Self::BestEffort => (Reliability::BestEffort, Durability::Volatile, 5),
            Self::Latched => (reliable, Durability::TransientLocal, 1),
        };
        let history = History::KeepLast { depth };
        QosPolicyBuilder::new().reliability(reliability).durability(durability).history(history).build()
    }
}

/// A participant in a domain.
pub struct Ros2Node {
    participant: DomainParticipant,
    publisher: rustdds::Publisher,
    subscriber: rustdds::Subscriber,
    domain: u16,
}

impl Ros2Node {
    /// Joins a domain. With `interface`, an address of this computer, only the network of that address is used; the
    /// loopback address keeps all traffic on this computer.
    ///
    /// # Errors
    /// [`Ros2Error`] for a domain or an address that does not exist, or if no socket can be opened.
    pub fn new(domain: u16, interface: Option<IpAddr>) -> Result<Self, Ros2Error> {
        if domain > MAX_DOMAIN {
            return Err(Ros2Error::Domain(domain));
        }
        let mut builder = DomainParticipantBuilder::new(domain);
        if let Some(address) = interface {
            UdpSocket::bind((address, 0)).map_err(|source| Ros2Error::Interface { address, source })?;
            builder = builder.with_only_networks([address]);
        }
        let failed = |error: rustdds::dds::CreateError| dds_error("participant", domain, &error);
        let participant = builder.build().map_err(failed)?;
        let qos = QosPolicyBuilder::new().build();
        let publisher = participant.create_publisher(&qos).map_err(failed)?;
        let subscriber = participant.create_subscriber(&qos).map_err(failed)?;
        Ok(Self { participant, publisher, subscriber, domain })
    }

    /// Returns the number of the domain.
    pub fn domain(&self) -> u16 {
        self.domain
    }

    fn topic<M: Message>(&self, topic: &str, qos: &QosPolicies) -> Result<rustdds::Topic, Ros2Error> {
        let name = dds_topic(topic)?;
        self.participant
            .create_topic(name, dds_type(M::NAME), qos, TopicKind::NoKey)
            .map_err(|error| dds_error(topic, self.domain, &error))
    }

    /// Announces a topic.
    ///
    /// # Errors
    /// [`Ros2Error`] for a name that is not one of ROS 2, or if the DDS library refuses.
    pub fn publish<M: Message>(&self, topic: &str, profile: QosProfile) -> Result<Publisher<M>, Ros2Error> {
        let qos = profile.policies();
        let writer = self
            .publisher
            .create_datawriter_no_key(&self.topic::<M>(topic, &qos)?, Some(qos))
            .map_err(|error| dds_error(topic, self.domain, &error))?;
        let (topic, domain, unsent) = (topic.to_owned(), self.domain, AtomicU64::new(0));
        Ok(Publisher { writer, participant: self.participant.clone(), topic, domain, unsent, message: PhantomData })
    }

    /// Subscribes to a topic.
    ///
    /// # Errors
    /// [`Ros2Error`] for a name that is not one of ROS 2, or if the DDS library refuses.
    pub fn subscribe<M: Message + 'static>(
        &self,
        topic: &str,
        profile: QosProfile,
    ) -> Result<Subscription<M>, Ros2Error> {
        let qos = profile.policies();
        let reader = self
            .subscriber
            .create_simple_datareader_no_key(&self.topic::<M>(topic, &qos)?, Some(qos))
            .map_err(|error| dds_error(topic, self.domain, &error))?;
        Ok(Subscription { reader, participant: self.participant.clone(), topic: topic.to_owned(), domain: self.domain })
    }
}

fn dds_error(item: &str, domain: u16, error: &dyn std::fmt::Display) -> Ros2Error {
    Ros2Error::Dds { item: item.to_owned(), domain, reason: error.to_string() }
}

/// The body of an encoded message.
struct Encoded(Bytes);

/// Passes encoded messages on.
struct EncodedAdapter;

impl SerializerAdapter<Encoded> for EncodedAdapter {
    type Error = CdrError;

    fn output_encoding() -> RepresentationIdentifier {
        RepresentationIdentifier::CDR_LE
    }

    fn to_bytes(value: &Encoded) -> Result<Bytes, CdrError> {
        Ok(value.0.clone())
    }
}

/// Decodes messages.
struct MessageAdapter<M>(PhantomData<M>);

impl<M> Clone for MessageAdapter<M> {
    fn clone(&self) -> Self {
        Self(PhantomData)
    }
}

impl<M: Message> DeserializerAdapter<M> for MessageAdapter<M> {
    type Error = CdrError;
    type Decoded = M;

    fn supported_encodings() -> &'static [RepresentationIdentifier] {
        &[RepresentationIdentifier::CDR_LE, RepresentationIdentifier::CDR_BE]
    }

    fn transform_decoded(decoded: M) -> M {
        decoded
    }
}

impl<M: Message> DefaultDecoder<M> for MessageAdapter<M> {
    type Decoder = Self;
    const DECODER: Self = Self(PhantomData);
}

impl<M: Message> Decode<'_, M> for MessageAdapter<M> {
    type Error = CdrError;

    fn decode_bytes(self, bytes: &[u8], encoding: RepresentationIdentifier) -> Result<M, CdrError> {
        let order = if encoding == RepresentationIdentifier::CDR_BE { ByteOrder::Big } else { ByteOrder::Little };
        M::read(&mut CdrReader::from_body(bytes, order))
    }
}

/// Sends the messages of a topic.
pub struct Publisher<M> {
    writer: DataWriter<Encoded, EncodedAdapter>,
    participant: DomainParticipant,
    topic: String,
    domain: u16,
    unsent: AtomicU64,
    message: PhantomData<fn(M)>,
}

impl<M: Message> Publisher<M> {
    /// Sends a message to all subscribers. It never waits for them: a message that finds the queue to a slow subscriber
    /// full is left out ([`Self::unsent`]).
    ///
    /// # Errors
    /// [`Ros2Error::Dds`] if the DDS library fails.
    pub fn send(&self, message: &M) -> Result<(), Ros2Error> {
        let body = Bytes::from(message.to_cdr()).slice(HEADER_SIZE..);
        match self.writer.write(Encoded(body), None) {
            Ok(()) => Ok(()),
            Err(rustdds::dds::WriteError::WouldBlock { .. }) => {
                self.unsent.fetch_add(1, Ordering::Relaxed);
                Ok(())
            }
            Err(error) => Err(dds_error(&self.topic, self.domain, &error)),
        }
    }

    /// Returns the name of the topic.
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Returns the error of a message of this topic that has the fault `source`.
    pub(crate) fn message_error(&self, source: CdrError) -> Ros2Error {
        Ros2Error::Message { topic: self.topic.clone(), domain: self.domain, source }
    }

    /// Returns the number of messages left out because a subscriber was too slow.
    pub fn unsent(&self) -> u64 {
        self.unsent.load(Ordering::Relaxed)
    }

    /// Returns the number of subscribers of other participants found in the domain.
    pub fn subscribers(&self) -> usize {
        let (name, own) = (format!("rt{}", self.topic), self.participant.guid().prefix);
        let readers = self.participant.discovered_readers();
        readers
            .iter()
            .filter(|reader| reader.reader_proxy.remote_reader_guid.prefix != own)
            .filter(|reader| *reader.subscription_topic_data.topic_name() == name)
            .count()
    }

    /// Waits for a subscriber. Returns true if there is one within `timeout`.
    pub fn wait_for_subscriber(&self, timeout: Duration) -> bool {
        poll(timeout, || (self.subscribers() > 0).then_some(())).is_some()
    }

    /// Waits until all messages have been acknowledged by reliable subscribers. Returns true if they were within
    /// `timeout`.
    pub fn wait_for_acknowledgment(&self, timeout: Duration) -> bool {
        self.writer.wait_for_acknowledgments(timeout).unwrap_or(false)
    }
}

/// Receives the messages of a topic.
pub struct Subscription<M: Message + 'static> {
    reader: SimpleDataReader<M, MessageAdapter<M>>,
    participant: DomainParticipant,
    topic: String,
    domain: u16,
}

impl<M: Message + 'static> Subscription<M> {
    /// Returns the name of the topic.
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Returns the next message that has arrived, if any.
    ///
    /// # Errors
    /// [`Ros2Error`] for a message that cannot be read, or if the DDS library fails.
    pub fn take(&self) -> Result<Option<M>, Ros2Error> {
        self.reader.drain_read_notifications();
        match self.reader.try_take_one() {
            Ok(sample) => Ok(sample.map(rustdds::no_key::DeserializedCacheChange::into_value)),
            Err(error) => Err(dds_error(&self.topic, self.domain, &error)),
        }
    }

    /// Returns the newest message that has arrived, if any; older ones are left out.
    ///
    /// # Errors
    /// As [`Self::take`].
    pub fn take_newest(&self) -> Result<Option<M>, Ros2Error> {
        let mut newest = None;
        while let Some(message) = self.take()? {
            newest = Some(message);
        }
        Ok(newest)
    }

    /// Waits for a message.
    ///
    /// # Errors
    /// [`Ros2Error::Silent`] if none arrives within `timeout`, and as [`Self::take`].
    pub fn wait(&self, timeout: Duration) -> Result<M, Ros2Error> {
        poll(timeout, || self.take_newest().transpose()).unwrap_or_else(|| Err(self.silent(timeout)))
    }

    /// Returns the error of a topic without a message for `timeout`.
    pub fn silent(&self, timeout: Duration) -> Ros2Error {
        let name = format!("rt{}", self.topic);
        let own = self.participant.guid().prefix;
        let writers = self.participant.discovered_writers();
        let topics: Vec<_> = writers
            .iter()
            .filter(|writer| writer.writer_proxy.remote_writer_guid.prefix != own)
            .map(|writer| &writer.publication_topic_data)
            .collect();
        let publishers: Vec<_> = topics.iter().filter(|topic| topic.topic_name == name).collect();
        let found = match publishers.iter().find(|topic| topic.type_name != dds_type(M::NAME)) {
            _ if topics.is_empty() => "nobody publishes anything in this domain".to_owned(),
            Some(other) => format!("it is published as {}", other.type_name),
            None if publishers.is_empty() => {
                format!("nobody publishes it; {} other topics are published", topics.len())
            }
            None => format!("{} publish it", publishers.len()),
        };
        Ros2Error::Silent {
            topic: self.topic.clone(),
            domain: self.domain,
            seconds: timeout.as_secs_f64(),
            found,
            kind: M::NAME,
        }
    }
}

/// Calls `attempt` until it returns a value, for `timeout` at most.
fn poll<T>(timeout: Duration, mut attempt: impl FnMut() -> Option<T>) -> Option<T> {
    let begun = Instant::now();
    loop {
        match attempt() {
            Some(value) => return Some(value),
            None if begun.elapsed() >= timeout => return None,
            None => std::thread::sleep(POLL_INTERVAL),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_domain_or_an_address_that_does_not_exist_is_refused() {
        let error = |domain, address: Option<[u8; 4]>| {
            Ros2Node::new(domain, address.map(IpAddr::from)).err().expect("refused").to_string()
        };
        assert_eq!(error(233, None), "domain: found 233, expected 0 to 232");
        let message = error(0, Some([203, 0, 113, 9]));
        assert!(
            message.starts_with("interface: found 203.0.113.9, expected an address of this computer ("),
            "{message}"
        );
    }

    /// A latched topic keeps its last message, and no publisher waits for a slow subscriber.
    #[test]
    fn profiles_are_those_of_ros() {
        let latched = QosProfile::Latched.policies();
        assert_eq!(latched.durability(), Some(Durability::TransientLocal));
        assert_eq!(latched.history(), Some(History::KeepLast { depth: 1 }));
        assert!(latched.is_reliable() && !QosProfile::BestEffort.policies().is_reliable());
        assert_eq!(QosProfile::Reliable.policies().reliable_max_blocking_time(), Some(rustdds::Duration::ZERO));
    }
}
