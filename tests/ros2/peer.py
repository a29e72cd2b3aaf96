"""A peer of another DDS implementation, Cyclone DDS, with the names and the quality of service of ROS 2."""

import os
import time

# The address is that of the host in the network of the test. Without multicast, peers are found at this address alone.
ADDRESS = os.environ.get("FTAC_ROS2_ADDRESS", "127.0.0.1")
os.environ["CYCLONEDDS_URI"] = f"""<CycloneDDS><Domain Id="any">
<General><Interfaces><NetworkInterface address="{ADDRESS}"/></Interfaces>
<AllowMulticast>{os.environ.get("FTAC_ROS2_MULTICAST", "false")}</AllowMulticast></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>9</MaxAutoParticipantIndex>
<Peers><Peer address="{ADDRESS}"/></Peers></Discovery>
</Domain></CycloneDDS>"""

from cyclonedds.core import Policy, Qos  # noqa: E402
from cyclonedds.domain import DomainParticipant  # noqa: E402
from cyclonedds.internal import InvalidSample  # noqa: E402
from cyclonedds.pub import DataWriter  # noqa: E402
from cyclonedds.sub import DataReader  # noqa: E402
from cyclonedds.topic import Topic  # noqa: E402
from cyclonedds.util import duration  # noqa: E402


def profile(reliable=True, latched=False, depth=10):
    """Quality of service."""
    return Qos(
        Policy.Reliability.Reliable(duration(milliseconds=100)) if reliable else Policy.Reliability.BestEffort,
        Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
        Policy.History.KeepLast(depth),
    )


class Peer:
    """A participant in a domain."""

    def __init__(self, domain):
        self.participant = DomainParticipant(domain)

    def subscribe(self, name, message, **qos):
        topic = Topic(self.participant, "rt" + name, message, qos=profile(**qos))
        return DataReader(self.participant, topic, qos=profile(**qos))

    def publish(self, name, message, **qos):
        topic = Topic(self.participant, "rt" + name, message, qos=profile(**qos))
        return DataWriter(self.participant, topic, qos=profile(**qos))


def take(reader):
    """Messages that have arrived."""
    return [message for message in reader.take(N=50) if not isinstance(message, InvalidSample)]


def first(reader, seconds=60):
    """The first message of a reader within a time limit."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for message in take(reader):
            return message
        time.sleep(0.005)
    raise SystemExit(f"no message on {reader.topic.name} within {seconds} s")
