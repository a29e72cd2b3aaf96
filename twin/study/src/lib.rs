//! The grasp study: the paper's second half of results, made from this project's own verified grasps.
