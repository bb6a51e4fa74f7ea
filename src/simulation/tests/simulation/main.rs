//! Runs in lockstep: the world, drivers and right of way on shipped and made maps, under noise and lag.

mod city;
mod driving;
mod robustness;
mod roundabout;
mod seen;
mod unseen;
mod world;
