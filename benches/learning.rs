//! Duration of training: labelling by simulation, training on the preset's batches, ranking 50,000 actions.
//! `cargo bench --bench learning`

use std::time::Instant;

use iplw::policy::{CHUNK, LabelConfig, TrainConfig, TrainingPhysics, label, rank, train};
use iplw::progress::NoProgress;
use iplw::reality::standard;
use iplw::task::{Split, families, split};

fn main() -> Result<(), iplw::error::Error> {
    for family in families() {
        let name = family.name;
        let tasks = family.tasks();
        let training = split(&tasks, Split::Train);
        let latents = standard(family).latents;
        let labels = LabelConfig::preset(&family.learning.study_labels, 0);
        let start = Instant::now();
        let data =
            label(&training, &TrainingPhysics::Fixed { latents, effects: Vec::new() }, &labels, &NoProgress)?;
        let labelled = start.elapsed().as_secs_f64();
        let config = TrainConfig::preset(&family.learning);
        let (policy, _) = train(&data, &config, &NoProgress)?;
        let trained = start.elapsed().as_secs_f64() - labelled;
        let task = &split(&tasks, Split::Test)[0];
        let count = task.actions().count().min(50_000);
        let actions = (0..count).map(|i| task.actions().at(i)).collect::<Result<Vec<_>, _>>()?;
        let mut ranked = Vec::new();
        for _ in 0..5 {
            let start = Instant::now();
            let order = rank(&policy, task, &actions, CHUNK)?;
            assert_eq!(order.len(), count);
            ranked.push(start.elapsed().as_secs_f64());
        }
        ranked.sort_by(f64::total_cmp);
        println!(
            "{name}: {} labels in {labelled:.2} s, {} batches of {} in {trained:.2} s, together {:.2} s; \
             {count} actions ranked in {:.3} s (median of 5; {:.3} to {:.3})",
            data.rows.len(),
            config.batches,
            config.batch_size,
            labelled + trained,
            ranked[2],
            ranked[0],
            ranked[4]
        );
    }
    Ok(())
}
