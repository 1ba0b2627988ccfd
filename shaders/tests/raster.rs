#[test]
fn parses() {
    use lodestream_shaders::passes::*;
    for pass in [RASTER, RASTER_MASKED, RASTER_OVERDRAW, SHADE, PRESENT] {
        for count in [1, 2] {
            let source = pass.source(PoolBindings { count, words_log2: 25 });
            let module = match naga::front::wgsl::parse_str(&source) {
                Ok(module) => module,
                Err(error) => panic!("{}", error.emit_to_string(&source)),
            };
            let mut validator = naga::valid::Validator::new(
                naga::valid::ValidationFlags::all(),
                naga::valid::Capabilities::SHADER_INT64
                    | naga::valid::Capabilities::SHADER_INT64_ATOMIC_MIN_MAX,
            );
            if let Err(error) = validator.validate(&module) {
                panic!("{} {}", pass.name, error.emit_to_string(&source));
            }
        }
    }
}
