//! scratch
use plant_sim::exact::*;
use plant_sim::phs::*;
use std::time::Instant;
fn thesis() -> Phs {
    Phs {
        mass_kg: 1.0148e-3,
        damping_n_s_per_m: 3.7356,
        stiffness_n_per_m: 24579.0,
        transduction_c_per_m: 0.046311,
        hysterons: vec![
            Hysteron { capacitance_f: 5.6425e-7, slope_s: 0.6002, dead_zone_v: 14.5126 },
            Hysteron { capacitance_f: 5.2125e-7, slope_s: 1.1528e-4, dead_zone_v: 8.6838 },
        ],
    }
}
fn rk4(p: &Phs, x: &mut PhsState, u: f64, t: f64, n: usize) {
    let h = t / n as f64;
    let add = |a: &PhsState, b: &PhsState, s: f64| PhsState {
        displacement_m: a.displacement_m + s * b.displacement_m,
        velocity_m_per_s: a.velocity_m_per_s + s * b.velocity_m_per_s,
        hysteron_v: a.hysteron_v.iter().zip(&b.hysteron_v).map(|(a, b)| a + s * b).collect(),
    };
    for _ in 0..n {
        let k1 = p.derivative(x, u, 0.0);
        let k2 = p.derivative(&add(x, &k1, h / 2.0), u, 0.0);
        let k3 = p.derivative(&add(x, &k2, h / 2.0), u, 0.0);
        let k4 = p.derivative(&add(x, &k3, h), u, 0.0);
        *x = add(&add(&add(&add(x, &k1, h / 6.0), &k2, h / 3.0), &k3, h / 3.0), &k4, h / 6.0);
    }
}
#[test]
fn compare() {
    let p = thesis();
    let d = Dynamics::of_plant(&p);
    let ts = 1e-4;
    for amp in [64.0, 90.0] {
        let mut s = stepper(&d, Spans::whole(ts));
        let mut x = p.relaxed();
        let mut worst = 0.0f64;
        for k in 0..200 {
            let u =
                amp * (2.0 * std::f64::consts::PI * 150.0 * k as f64 * ts).sin() + if k == 100 { 50.0 } else { 0.0 };
            s.advance(0, p.transduction_c_per_m * u, 0.0);
            rk4(&p, &mut x, u, ts, 20000);
            worst = worst.max((s.state(0) - x.displacement_m).abs());
        }
        println!("amp {amp} worst {worst:e} m  end {:e} regions {}", s.state(0), s.regions_built());
    }
    let n = 1_000_00;
    for amp in [60.0, 90.0] {
        let f: Vec<f64> = (0..n)
            .map(|k| p.transduction_c_per_m * amp * (2.0 * std::f64::consts::PI * 100.0 * k as f64 * ts).sin())
            .collect();
        for _ in 0..3 {
            let t = Instant::now();
            let mut s = stepper(&d, Spans::whole(ts));
            let mut y = Vec::with_capacity(n);
            s.record(&mut f.iter().copied(), &mut y);
            println!("{amp} open loop {:.1} ns/sample", t.elapsed().as_secs_f64() / n as f64 * 1e9);
        }
    }
    for _ in 0..3 {
        let t = Instant::now();
        for _ in 0..1000 {
            let mut s = stepper(&d, Spans::whole(ts));
            for i in 0..9 {
                let a = (i % 3) as f64 - 1.0;
                let b = (i / 3) as f64 - 1.0;
                s.set_state(&[0.0, 0.0, a * 10.0, b * 10.0]);
            }
            std::hint::black_box(s.regions_built());
        }
        println!("tables {:.2} us", t.elapsed().as_secs_f64() * 1e3);
    }
    let inputs: Vec<(f64, f64)> = (0..2000)
        .map(|k| {
            (
                80.0 * (2.0 * std::f64::consts::PI * 50.0 * k as f64 * ts).sin() + if k == 500 { 40.0 } else { 0.0 },
                if k > 700 { 0.3 } else { 0.0 },
            )
        })
        .collect();
    let (_, l) = energy::audited_run(&p, &p.relaxed(), ts, &inputs).unwrap();
    println!("{l:?} imbalance {:e} rel {:e}", l.imbalance_j(), l.imbalance_j() / (l.peak_j + l.exchanged_j));
}
