"""Forces and torques of a motion: contact points, object masses, drives, and the wrenches that nothing supplies."""
