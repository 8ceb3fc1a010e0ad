"""The quality-of-service profiles of every topic, stated once.

CANDIDATES   optimizer → hand. Reliable, not kept for late joiners: an old candidate is not to be tried.
QUALITIES    hand → everybody. Reliable and kept by the publisher, so that a solution set or an optimizer
             that was restarted in mid-run is sent the trials that it missed.
LATCHED      states: a late subscriber gets the newest one.
TF_STATIC    as tf2 publishes /tf_static: every broadcaster keeps what it said.
"""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

CANDIDATES = QoSProfile(
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
    history=HistoryPolicy.KEEP_LAST,
    depth=100,
)

QUALITIES = QoSProfile(
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
    history=HistoryPolicy.KEEP_LAST,
    depth=1000,
)

LATCHED = QoSProfile(
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
)

TF_STATIC = QoSProfile(
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
    history=HistoryPolicy.KEEP_LAST,
    depth=100,
)
