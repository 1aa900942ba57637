"""What several experiments share: cells run whole, benches, objects to grasp."""
