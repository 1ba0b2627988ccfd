# Each target installs what a fresh Debian or Ubuntu machine with Rust, a C compiler and make still lacks, or says what to install.
.PHONY: demo test test-s3 cases servers kills faults abuse schemathesis replicas draw priorities report judges bench lint build

CARGO ?= cargo

build:
	$(CARGO) build --release --workspace

# Ingest, serve, stream a camera path, write pictures and a report; target/demo holds them.
demo: build
	@.ci/vulkan
	@loadtests/demo.sh

# A passing test's output is hidden, its SKIPPED line too: what a whole missing folder skips is said here.
test:
	@.ci/vulkan
	@[ -d ../shared/models ] || echo "SKIPPED: tests over ../shared/models, which is not there (they count as passed below)"
	@[ -n "$$LODESTREAM_TEST_S3" ] || echo "SKIPPED: the library's tests over S3 (make test-s3 runs them; they count as passed below)"
	@if $(CARGO) nextest --version >/dev/null 2>&1; then \
	  $(CARGO) nextest run --workspace --no-fail-fast; \
	else \
	  $(CARGO) test --workspace --no-fail-fast; \
	fi
	@if [ -d ../shared/cases ]; then $(MAKE) --no-print-directory cases; \
	else echo "SKIPPED: make cases, the inputs of ../shared/cases, which is not there"; fi

# Every input of ../shared/cases and ../shared/models, and generated ones of their kinds.
cases: build
	@.ci/vulkan
	@loadtests/cases/__main__.py

# Every store passes the library's tests: also a server that speaks S3, which this starts.
test-s3:
	@.ci/s3 $(CARGO) test -p lodestream-server --test library --test library_copy --test library_repair --test library_mark

# Page requests a second against nginx, which has to be installed.
servers: build
	@loadtests/servers.sh

# kill -9 at 500 random points of ingest, publishing and gc, then disks that are too small.
kills: build
	@loadtests/kills.py target/release/lodestream-server target/kills
	@loadtests/full_disk.sh target/release/lodestream-server target/kills

# A store that is down, slow, cut short, changed on the way or answers with errors, under each command and under viewers.
faults: build
	@loadtests/faults.py

# Clients that mean harm: each attack on a server of its own, with a good client beside it.
abuse: build
	@loadtests/abuse/__main__.py

# Requests made up from the server's OpenAPI document.
schemathesis: build
	@loadtests/schemathesis.sh

# Three servers over one S3 library behind nginx, which has to be installed; one is killed under load.
replicas: build
	@loadtests/replicas.sh

# Error against run time: target/report/index.html with the JSON beside it.
report: build
	@.ci/vulkan
	@loadtests/report.sh

# The build against its goals, a row a model of ../shared/models: target/judges. MODELS, PARTS and
# ROCKS (millions of triangles: 1,100) choose, BEFORE is the JSON of another run; SERVER, CLIENT and
# LOADTESTS name other programs.
judges: build
	@.ci/vulkan
	@loadtests/judges.sh $(if $(BEFORE),--before "$(BEFORE)") $(if $(PARTS),--parts "$(PARTS)") $(if $(ROCKS),--rocks "$(ROCKS)") $(MODELS)

# Occlusion culling and the compute rasterizer, each alone and together: target/draw.
draw: build
	@.ci/vulkan
	@loadtests/draw.sh

# Pages in the order of what all instances gain, against the largest gain: target/priorities.
priorities: build
	@loadtests/priorities.sh

bench:
	$(CARGO) bench --workspace

lint:
	$(CARGO) fmt --all --check
	$(CARGO) clippy --workspace --all-targets -- -D warnings
	$(CARGO) check -p lodestream-client --no-default-features
