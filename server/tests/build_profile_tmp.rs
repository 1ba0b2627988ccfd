mod build_support;
#[test]
fn profile() {
    let mesh = build_support::meshes::torus(500, 250);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap();
    let built =
        pool.install(|| lodestream_server::build::build(&mesh, &Default::default()).unwrap());
    println!("{:?}", built.report.seconds);
}
