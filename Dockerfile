# The two commands of the README, without privileges:
#
#   docker build --build-arg UID="$(id -u)" --tag yeastfit .
#   mkdir -p out && docker run --rm --volume "$PWD/out:/opt/yeastfit/out" yeastfit    # make demo
#   docker run --rm yeastfit make test
#
# With Apptainer, on a cluster, where the folder one stands in is mounted:
#
#   apptainer build yeastfit.sif docker-daemon:yeastfit:latest
#   apptainer exec yeastfit.sif yeastfit fit FOLDER --out out/fit
FROM python:3.13-slim

# git tells the version. Debian keeps one version of either package, so that there is nothing to pin.
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install --yes --no-install-recommends git make \
    && rm -rf /var/lib/apt/lists/*

ARG UID=1000
RUN useradd --uid "$UID" --create-home yeastfit \
    && install --directory --owner=yeastfit /opt/yeastfit
USER $UID
WORKDIR /opt/yeastfit

COPY --chown=yeastfit . .
RUN make .venv/.installed-test
ENV PATH=/opt/yeastfit/.venv/bin:$PATH

CMD ["make", "demo"]
