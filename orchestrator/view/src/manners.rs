//! A watcher's process takes nothing that a flight needs: it has the lowest priority, and is never on a service's core.

use runtime::deployment;

/// Gives this thread, and those that it will start, what others leave over. The flight loses little if that is refused.
pub fn be_idle() {
    let _ = deployment::use_idle();
}

/// Keeps this process off the cores of a flight's services.
#[derive(Debug)]
pub struct Distance {
    /// The cores that this process was given.
    given: Vec<usize>,
    /// Those that it uses.
    used: Vec<usize>,
}

impl Distance {
    /// Uses all cores that this process was given.
    #[must_use]
    pub fn none() -> Self {
        let given = deployment::allowed_cores();
        Self {
            used: given.clone(),
            given,
        }
    }

    /// Leaves the cores that these processes are bound to, if there are others.
    pub fn keep_from(&mut self, processes: impl Iterator<Item = u32>) {
        let taken: Vec<_> = processes.filter_map(deployment::cores_of).collect();
        let free = free_of(&self.given, &taken);
        // Only slower for the flight if it is refused.
        if free != self.used && deployment::pin_all_threads_to(&free).is_ok() {
            self.used = free;
        }
    }
}

/// Returns the cores that nobody is bound to; all of them if there are none.
fn free_of(given: &[usize], taken: &[Vec<usize>]) -> Vec<usize> {
    // A process that may run anywhere has no core of its own.
    let is_bound = |cores: &&Vec<usize>| given.iter().any(|core| !cores.contains(core));
    let bound: Vec<_> = taken.iter().filter(is_bound).flatten().collect();
    let free: Vec<_> = given
        .iter()
        .copied()
        .filter(|core| !bound.contains(&core))
        .collect();
    if free.is_empty() { given.to_vec() } else { free }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_core_of_the_services_is_left_to_them() {
        assert_eq!(free_of(&[0, 1, 2, 3], &[vec![2], vec![2], vec![3]]), [0, 1]);
    }

    #[test]
    fn services_that_may_run_anywhere_take_no_core_and_those_on_all_cores_leave_none() {
        assert_eq!(free_of(&[0, 1], &[vec![0, 1], vec![0, 1, 2]]), [0, 1]);
        assert_eq!(free_of(&[0, 1], &[vec![0], vec![1]]), [0, 1]);
        assert_eq!(free_of(&[0], &[vec![0]]), [0]);
    }
}
