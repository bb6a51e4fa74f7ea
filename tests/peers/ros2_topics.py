"""What Cyclone DDS lists of a domain: arguments are the domain and names of DDS topics that have to be there."""

import sys
import time

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.domain import DomainParticipant

participant = DomainParticipant(int(sys.argv[1]))
reader = BuiltinDataReader(participant, BuiltinTopicDcpsPublication)
wanted, seen, until = set(sys.argv[2:]), {}, time.monotonic() + 20
while wanted - set(seen) and time.monotonic() < until:
    for sample in reader.take(N=100):
        if hasattr(sample, "topic_name"):
            seen[sample.topic_name] = sample.type_name
    time.sleep(0.1)
for name in sorted(wanted & set(seen)):
    print(name, seen[name])
print(len(seen), "topics")
sys.exit(f"not listed: {sorted(wanted - set(seen))}" if wanted - set(seen) else 0)
