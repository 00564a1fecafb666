//! The kernel for graphics processors gives the bits of the batched engine: compiled for the processor here, and on a
//! device where there is one.

use std::sync::Mutex;

use iplw::error::{Error, Result};
use iplw::task::Scene;
use iplw::task::scene::{EffectTerm, Goal};
use iplw::trajectory::Trajectory;
use iplw::world::effect::{Effect, EffectKind, REGISTRY};
use iplw::world::{Accelerator, Engine, Rollout, RolloutImages, Simulator};
use iplw_gpu::{Output, run};
use proptest::strategy::{Strategy, ValueTree};
use proptest::test_runner::TestRunner;
use rayon::prelude::*;

use crate::lanes::{box_scene, disc, disc_scenes, mixed_scenes, same};
use crate::properties::{any_scene, islands};
use crate::thread_memory::bytes_taken;

/// Rollouts of a thread, one after the other.
const ROLLOUTS_PER_THREAD: usize = 3;

/// The kernel on the processor, with the number of rollouts that it ran.
#[derive(Default)]
struct Emulator(Mutex<usize>);

impl Accelerator for Emulator {
    fn run(&self, work: &RolloutImages) -> Result<Vec<f64>> {
        *self.0.lock().unwrap() += work.rollouts();
        let mut outputs = vec![0.0; work.rollouts() * work.output_len];
        let images: Vec<&[f64]> = work.starts.windows(2).map(|ends| &work.images[ends[0]..ends[1]]).collect();
        let of_threads = outputs.par_chunks_mut(ROLLOUTS_PER_THREAD * work.output_len);
        of_threads.zip(images.par_chunks(ROLLOUTS_PER_THREAD)).for_each(|(numbers, images)| {
            let mut left = images.iter().zip(numbers.chunks_mut(work.output_len));
            let next = || left.next().map(|(image, numbers)| (*image, Output::new(numbers)));
            let taken = bytes_taken(|| run(&work.topology, next));
            assert!(taken <= work.arena_kb * 1024, "{taken} bytes in a thread with {} kB", work.arena_kb);
        });
        Ok(outputs)
    }

    fn capacity(&self, _: usize) -> usize {
        1000
    }
}

/// Compares the engines on all scenes; returns the number of rollouts that the kernel ran.
fn compare(scenes: &[Scene], label: &str) -> usize {
    compare_rollouts(&scenes.iter().map(Rollout::of).collect::<Vec<Rollout>>(), label)
}

/// The same for rollouts.
fn compare_rollouts(rollouts: &[Rollout], label: &str) -> usize {
    let wanted: Vec<Trajectory> = Simulator::new(Engine::Auto).run(rollouts).unwrap();
    let emulator = Emulator::default();
    let simulator = Simulator::new(Engine::Gpu).accelerator(&emulator);
    let ours = simulator.run(rollouts).unwrap();
    let ran = *emulator.0.lock().unwrap();
    same(&ours, &wanted, label);
    let wanted_outcomes = Simulator::new(Engine::Auto).without_samples().run(rollouts).unwrap();
    same(
        &simulator.without_samples().run(rollouts).unwrap(),
        &wanted_outcomes,
        &format!("{label}, outcomes"),
    );
    match Simulator::new(Engine::Gpu).run(rollouts) {
        Ok(on_device) => same(&on_device, &wanted, &format!("{label}, on the device")),
        // Only the absence of a device is no failure.
        Err(error @ Error::Input(_)) => eprintln!("{label}: not compared on a device: {error}"),
        Err(error) => panic!("{label}, on the device: {error}"),
    }
    eprintln!("{label}: {ran} of {} rollouts by the kernel", rollouts.len());
    ran
}

/// Scenes of a strategy, with each effect that changes motion or contacts in turn.
fn random_scenes(strategy: impl Strategy<Value = Scene>, count: usize) -> Vec<Scene> {
    let mut runner = TestRunner::deterministic();
    let effects: Vec<&Effect> = REGISTRY
        .iter()
        .copied()
        .filter(|e| matches!(e.kind, EffectKind::Motion(_) | EffectKind::Contact(_) | EffectKind::Body(_)))
        .collect();
    (0..count)
        .map(|i| {
            let mut scene = strategy.new_tree(&mut runner).unwrap().current();
            if i % 2 == 1 {
                scene.effects =
                    vec![typical(effects[i / 2 % effects.len()]), typical(effects[i / 3 % effects.len()])];
            }
            scene
        })
        .collect()
}

/// An effect of its typical size.
fn typical(effect: &Effect) -> EffectTerm {
    let value = |p: &iplw::world::effect::ParameterDeclaration| {
        let [low, high] = p.bounds;
        (p.name.to_string(), (p.neutral + p.typical_size).clamp(low, high))
    };
    EffectTerm { name: effect.name.into(), parameters: effect.parameters.iter().map(value).collect() }
}

#[test]
fn tasks_and_mixed_scenes_have_the_same_bits() {
    let scenes = mixed_scenes();
    assert_eq!(compare(&scenes, "tasks"), scenes.len());
}

#[test]
fn ten_thousand_random_scenes_have_the_same_bits() {
    let ran = compare(&random_scenes(disc_scenes(), 3000), "discs")
        + compare(&random_scenes(islands(), 3000), "islands")
        + compare(&random_scenes(any_scene(), 4500), "any shapes");
    assert!(ran >= 10_000, "{ran}");
}

/// Stacks and random scenes that begin with established contacts, and the same without, in the same launch.
#[test]
fn warm_starts_have_the_same_bits() {
    let mut scenes = random_scenes(any_scene(), 600);
    scenes.extend(random_scenes(islands(), 200));
    for (i, scene) in random_scenes(disc_scenes(), 400).into_iter().enumerate() {
        // A pile that starts on the floor.
        let pile = (0..3 + i % 4)
            .map(|k| disc(&format!("b{k}"), 0.2, [0.01 * k as f64, 0.195 + 0.39 * k as f64], [0.0; 2]));
        scenes.extend([box_scene(pile.collect()), scene]);
    }
    scenes.iter_mut().for_each(|scene| scene.goal = None);
    let rollouts: Vec<Rollout> = scenes
        .iter()
        .enumerate()
        .map(|(i, scene)| Rollout { contacts_established: i % 3 > 0, ..Rollout::of(scene) })
        .collect();
    let cold: Vec<Rollout> = scenes.iter().map(Rollout::of).collect();
    let run = |rollouts: &[Rollout]| Simulator::new(Engine::Lanes).run(rollouts).unwrap();
    let changed = run(&rollouts).iter().zip(&run(&cold)).filter(|(a, b)| a != b).count();
    assert!(changed > 100, "warm starts change only {changed} rollouts: the test shows too little");
    assert!(compare_rollouts(&rollouts, "warm starts") > 1300);
}

/// More contacts than an output has room for: the rollout is repeated on the CPU.
#[test]
fn rollouts_with_many_contacts_have_the_same_bits() {
    let crowd = (0..12).map(|i| {
        let at = f64::from(i);
        let mut body =
            disc(&format!("b{i}"), 0.3, [at % 4.0 - 1.5, 1.0 + 1.5 * (at / 4.0).floor()], [6.0 - at, 2.0]);
        body.restitution = 1.0;
        body
    });
    let mut scene = box_scene(crowd.collect());
    scene.steps = 4000;
    scene.statics.iter_mut().for_each(|wall| wall.restitution = 1.0);
    let calm = box_scene(vec![disc("b0", 0.3, [0.0, 1.0], [1.0, 0.0])]);
    let events = |scene: &Scene| {
        Simulator::new(Engine::Gpu)
            .accelerator(&Emulator::default())
            .one(Rollout::of(scene))
            .unwrap()
            .events
            .len()
    };
    assert!(events(&scene) > 128 && events(&calm) < 128);
    compare(&[scene, calm], "many contacts");
}

/// An accelerator that fails after so many launches.
struct Failing {
    emulator: Emulator,
    launches: Mutex<usize>,
}

impl Failing {
    fn after(launches: usize) -> Failing {
        Failing { emulator: Emulator::default(), launches: Mutex::new(launches) }
    }
}

impl Accelerator for Failing {
    fn run(&self, work: &RolloutImages) -> Result<Vec<f64>> {
        let mut left = self.launches.lock().unwrap();
        if *left == 0 {
            return Err(Error::Failed("graphics processor: lost".into()));
        }
        *left -= 1;
        self.emulator.run(work)
    }

    fn capacity(&self, arena_kb: usize) -> usize {
        self.emulator.capacity(arena_kb)
    }
}

/// `auto` measures which of the two is faster, and continues on the CPU after a failure: the results are the same.
#[test]
fn auto_has_the_same_bits_wherever_it_runs() {
    let scenes: Vec<Scene> = (0..20_000)
        .map(|i| {
            let x = 1e-4 * f64::from(i);
            let mut scene = box_scene(vec![disc("b0", 0.3, [x, 1.0], [1.0, 0.0])]);
            scene.steps = 50;
            scene
        })
        .collect();
    let rollouts: Vec<Rollout> = scenes.iter().map(Rollout::of).collect();
    let wanted = Simulator::new(Engine::Lanes).run(&rollouts).unwrap();
    let on = |engine, accelerator: &dyn Accelerator| {
        Simulator::new(engine).accelerator(accelerator).run(&rollouts)
    };
    let emulator = Emulator::default();
    same(&on(Engine::Auto, &emulator).unwrap(), &wanted, "auto");
    assert!(*emulator.0.lock().unwrap() >= 1000, "no rollout ran on the accelerator");
    for launches in [0, 1] {
        same(&on(Engine::Auto, &Failing::after(launches)).unwrap(), &wanted, "auto after a failure");
        assert!(on(Engine::Gpu, &Failing::after(0)).unwrap_err().to_string().contains("lost"));
    }
    let few = &rollouts[..1000];
    let unused = Emulator::default();
    same(&Simulator::new(Engine::Auto).accelerator(&unused).run(few).unwrap(), &wanted[..1000], "few");
    assert_eq!(*unused.0.lock().unwrap(), 0, "a small batch ran on the accelerator");
}

/// Regions of different sizes in the same thread; those of more than 16 points run on the CPU.
#[test]
fn goals_of_any_region_have_the_same_bits() {
    let scenes: Vec<Scene> = (0..60)
        .map(|i| {
            let corners = 3 + i % 17;
            let corner = |k: u32| {
                let (sine, cosine) = (std::f64::consts::TAU * f64::from(k) / f64::from(corners)).sin_cos();
                [1.5 * cosine, 1.0 + sine]
            };
            let mut scene =
                box_scene(vec![disc("b0", 0.3, [0.1 * f64::from(i % 30) - 1.5, 4.0], [1.0, 0.0])]);
            let region = (0..corners).map(corner).collect();
            scene.goal = Some(Goal::Inside { body: "b0".into(), region, hold_s: 0.05, stop: None });
            scene
        })
        .collect();
    let small = scenes
        .iter()
        .filter(|scene| matches!(&scene.goal, Some(Goal::Inside { region, .. }) if region.len() <= 16));
    assert_eq!(compare(&scenes, "regions"), small.count());
}
