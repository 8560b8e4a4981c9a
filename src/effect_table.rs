//! The effect plan as a table, for `argus scene --plan` and `argus status --effects`.

use argus_scene::EffectPlan;
use argus_scene::effects::{Causes, EffectRow, Paid};

/// Prints a plan, one row an effect.
pub(crate) fn print(plan: &EffectPlan) {
    println!(
        "{:<15} {:<3} {:>9} {:>8} {:>8} {:>11}  {:<12} {:<30} why",
        "effect", "", "predicted", "measured", "saved", "bound", "paid", "causes"
    );
    for row in &plan.rows {
        let paid: Vec<&str> = row.paid.iter().map(|paid| Paid::name(*paid)).collect();
        println!(
            "{:<15} {:<3} {:>9} {:>8} {:>8} {:>11}  {:<12} {:<30} {}",
            row.effect.name(),
            if row.on { "on" } else { "off" },
            ms(row.predicted_ms),
            ms(row.measured_ms),
            ms(row.saved_ms),
            bound(row),
            paid.join(", "),
            causes(&row.causes),
            row.why,
        );
    }
    println!(
        "predicted: ms of a view from triangles of 640×480 pixels, by small views that were rendered to measure it"
    );
    println!("measured: the same, by views that were answered; saved: what an effect that is off would cost");
    println!("bound: the largest change of a pixel's byte when the effect is switched");
}

/// Milliseconds, or that they are not known.
fn ms(ms: Option<f64>) -> String {
    ms.map_or_else(|| "-".to_owned(), |ms| format!("{ms:.1}"))
}

/// The bound in bytes, of which one is rounding.
fn bound(row: &EffectRow) -> String {
    match row.bound {
        0.0 => "none".to_owned(),
        1.0 => "any".to_owned(),
        _ => format!("{:.1} bytes", row.bound_bytes()),
    }
}

/// Causes in a few words.
fn causes(causes: &Causes) -> String {
    let Causes { materials, lights, nodes, instances, sky } = causes;
    let lists = [("materials", materials), ("lights", lights), ("nodes", nodes), ("instances", instances)];
    let mut words: Vec<String> = lists
        .into_iter()
        .filter(|(_, list)| !list.is_empty())
        .map(|(name, list)| match list.len() {
            1..=3 => {
                let numbers: Vec<String> = list.iter().map(u32::to_string).collect();
                format!("{name} {}", numbers.join(","))
            }
            count => format!("{count} {name}"),
        })
        .collect();
    if *sky {
        words.push("sky".to_owned());
    }
    if words.is_empty() { "none".to_owned() } else { words.join(", ") }
}
