//! Words of the field that the window uses, each explained in a sentence.

/// Words with what they mean, in alphabetical order.
pub const WORDS: [(&str, &str); 28] = [
    ("CAV, HDV", "Connected and automated vehicle; human-driven vehicle, which nothing coordinates"),
    ("collision", "Two bodies touch, or one touches what is solid; who has collided stays there"),
    (
        "conflict zone",
        "Stretches of two lanes where vehicles on them could touch: a merge, where lanes become one, or a crossing",
    ),
    (
        "control zone",
        "Junctions and the road before them, where vehicles are coordinated and delays are measured",
    ),
    ("delay", "Time lost against driving the same way alone, with the time held outside the city"),
    ("DRAC", "Deceleration rate to avoid a crash: the least braking that keeps off the vehicle ahead"),
    ("environment", "Delays, losses, measurement errors and drives of a run: ideal, or as in the testbed"),
    ("gap", "Free road from the front bumper of a vehicle to the rear bumper of the one ahead"),
    ("headway", "How far a vehicle is behind the one ahead: as a time, the gap over the own speed"),
    ("held", "An arriving vehicle waits outside the city until there is room on its entry lane"),
    ("IDM", "Intelligent driver model: acceleration from speed, gap and closing speed (car following)"),
    ("instance", "One vehicle: a picture of instances has a colour for each"),
    (
        "lab vehicle",
        "A robot car in the laboratory, drawn where motion capture measures it; the others are virtual, and it feels nothing of them",
    ),
    (
        "lateral error",
        "Distance of the middle of the front axle from the path that it should follow, positive to the left",
    ),
    ("long standstill", "A vehicle stood for 30 s where it should be on its way"),
    (
        "measured pose",
        "Position and heading as motion capture tells them to the control, late and with errors",
    ),
    (
        "merge",
        "Two lanes become one, and their vehicles take turns; as an event: a vehicle has passed that place",
    ),
    (
        "mount",
        "Where a camera is on its vehicle, and where it looks: windscreen, bumper, rear, or as the scenario says",
    ),
    (
        "not tracked",
        "Motion capture has lost sight of a lab vehicle, and nobody knows its pose, until it is tracked again; two events (unseen)",
    ),
    ("plan", "Position over time of a coordinated vehicle through a control zone, agreed before it enters"),
    ("platoon", "Vehicles that follow one another closely with what they tell one another (CACC)"),
    (
        "post-encroachment time",
        "PET: from the exit of one vehicle out of a conflict zone to the entry of the next from the other side",
    ),
    ("real-time factor", "Simulated seconds per second of the clock on the wall"),
    ("right of way", "Who may enter the conflict zones of a junction first; the others yield"),
    (
        "slow stop",
        "A vehicle on its route becomes slower than 0.5 m/s; vehicles are counted so in queues and measures",
    ),
    ("standstill", "A vehicle has come to stand: it is slower than 0.1 m/s; an event"),
    ("time to collision", "TTC: gap over closing speed; the time until a crash if nobody changes speed"),
    ("yield", "To give way: a vehicle waits or slows down for one that has the right of way"),
];
