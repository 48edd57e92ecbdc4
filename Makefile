# make test     everything that must hold; sets up what it needs
# make lint     formatting and clippy
# make miri     the kernels' unit tests under Miri, which a nightly toolchain must have
# make doc      the library's documentation, in target/doc
# make book     the lecture as a book, by mdBook, in docs/book-html
# make bench    how to measure
# make scenes   remakes the data of the built-in scenes

CARGO ?= cargo
PYTHON ?= python3
CARGO_TARGET_DIR ?= target
export CARGO_TARGET_DIR

# Without any instruction that not every machine of this kind has.
ifeq ($(shell uname -m),x86_64)
PORTABLE = x86-64
else
PORTABLE = generic
endif

.PHONY: test tools layers test-rust test-portable test-pages miri doc book lint bench scenes
.NOTPARALLEL:

test: layers test-rust test-portable test-pages doc

tools:
	@command -v $(CARGO) >/dev/null || { echo "make: Rust is missing: https://rustup.rs" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || { echo "make: Python 3.10 or newer is missing" >&2; exit 1; }

# The arrows of the house: who may import whom, where `unsafe` may stand.
layers: tools
	$(PYTHON) scripts/check_layers.py
	$(PYTHON) -m unittest discover -q -s scripts

# The development profile is optimised (Cargo.toml): one profile serves all tests.
test-rust: tools
	$(CARGO) test --workspace --no-fail-fast

# The kernels' portable code, which the build for this very machine does not contain.
test-portable: tools
	RUSTFLAGS="-C target-cpu=$(PORTABLE)" $(CARGO) test -p rebond-lanes -p rebond-bvh --lib --tests --no-fail-fast \
		--target-dir $(CARGO_TARGET_DIR)/portable

# The pages in a real browser, and their figures by other programs; skipped where there is no Chromium.
test-pages: tools
	CARGO="$(CARGO)" PYTHON="$(PYTHON)" scripts/test_pages.sh

# Whether the kernels' portable code ever does what is undefined: `rustup toolchain install nightly --component miri,rust-src`.
# By tree borrows, because of the crate under rayon; that one also keeps memory and makes pointers of integers.
miri: tools
	MIRIFLAGS="-Zmiri-tree-borrows -Zmiri-permissive-provenance -Zmiri-ignore-leaks" RUSTFLAGS="-C target-cpu=$(PORTABLE)" \
		$(CARGO) +nightly miri test -p rebond-lanes -p rebond-bvh --lib --target-dir $(CARGO_TARGET_DIR)/miri

doc: tools
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc --workspace --lib --no-deps

# The chapters are what `rebond lecture` says: QUALITY=quick is a matter of minutes, full takes longer.
QUALITY ?= full
book: tools
	@command -v mdbook >/dev/null || { echo "make: mdBook is missing: cargo install mdbook" >&2; exit 1; }
	$(CARGO) run --release -p rebond-cli -- lecture --quality $(QUALITY) --book docs/book -o $(CARGO_TARGET_DIR)/lecture
	mdbook build docs

lint: tools
	$(CARGO) fmt --all --check
	$(CARGO) clippy --workspace --all-targets -- -D warnings

bench:
	@echo "The benchmarks compare with other programs and want a quiet machine; each folder says how:"
	@ls -d benches/*/README.md
	@echo "The ray kernel alone: cargo run --release -p rebond-bvh --example ray_kernel"

# dragon.ply as well, with DRAGON=dragon_vrip_res3.ply.gz of the Stanford 3D Scanning Repository.
scenes: tools
	$(PYTHON) scenes/make/checker.py scenes/checker.png
	$(PYTHON) scenes/make/sky.py scenes/sky.hdr
	$(PYTHON) scenes/make/window.py scenes/window.hdr
	$(PYTHON) scenes/make/gallery.py scenes
	$(PYTHON) scenes/make/many_lights.py scenes
	$(PYTHON) scenes/make/pot.py scenes/pot.ply
	$(if $(DRAGON),$(PYTHON) scenes/make/dragon.py $(DRAGON) scenes/dragon.ply)
