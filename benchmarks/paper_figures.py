"""What the paper's authors measured, on other clips and another machine."""

PROGRAMS = ("GMR", "OmniRetarget", "paper")
SCORES = {  # Table III: means over 3,997 clips of 13 kinds of object, contacts over 3,604.
    "contact_gap_m": (0.368, 0.183, 0.005),
    "body_pose_deviation_deg": (20.0, 25.0, 21.0),
    "link_velocity_direction_deg": (19.4, 28.9, 25.2),
    "relative_hand_rotation_deg": (2.3, 37.6, 6.1),
    "body_jerk_mps3": (66.7, 193.5, 49.9),
    "cpu_seconds": (9.1, 156.2, 33.7),
}
REFINED = {  # Table IV, their own references by RL tracker and by SBTO: 68 clips, contacts over 63.
    "pose_deg": (23.5, 23.1),
    "direction_deg": (46.7, 50.8),
    "object_cm": (21.3, 19.4),
    "gap_cm": (8.6, 9.9),
    "hand_deg": (25.3, 28.1),
    "jerk": (85.8, 55.4),
}
HORIZON_CLIPS = 130
HORIZON = {  # Table VII, with the collision cost or without: clips solved, s/clip, MB, deg, rad/s^3.
    ("per-frame", False): (130, 37.7, 1440, 40.3, 588),
    ("windowed:60:3", False): (130, 39.4, 1763, 24.4, 251),
    ("windowed:60:3", True): (130, 159.9, 3876, 24.5, 257),
    ("whole", False): (130, 45.8, 2400, 23.5, 185),
    ("whole", True): (87, 210.5, 8671, 24.4, 186),
}
RELEASED_CLIPS, RELEASED_HOURS = 6952, 13.8
SECONDS_A_FRAME = 0.145
"""Of their released program, measured elsewhere; the paper has 33.7 s a clip."""
