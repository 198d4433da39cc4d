# An extension of BlueOS: an exported law answers programs on the vehicle's computer, on UDP port 9100 of that machine.
# Copy this file into the folder of `uvms-mj export law`, with the targets armv7 and aarch64, and make the image there:
#
#   docker buildx build --platform linux/arm/v7,linux/arm64 -f blueos.Dockerfile -t YOU/LAW:0.1.0 --push .
#
# BlueOS on a Raspberry Pi has 32 bits, so linux/arm/v7 comes first. The image is made only if all recorded steps of
# test.c are equal. The labels are what BlueOS reads: put your names into them.
#
# With `uvms-mj new example ardusub_sender` in the folder, and --build-arg BASE=gate, the image also has Python, pymavlink
# and the sender of the gate for ArduSub. It does not start the sender: you do, each time that the law is to drive.
ARG BASE=scratch
FROM alpine:3.20 AS build
RUN apk add --no-cache gcc musl-dev
ARG NAME=gsta
ARG TARGETARCH
ARG TARGETVARIANT
COPY . /law
WORKDIR /law
RUN case "$TARGETARCH$TARGETVARIANT" in \
      armv7) target=armv7 ;; \
      arm64 | arm64v8) target=aarch64 ;; \
      amd64) target=x86_64 ;; \
      *) echo "no library for $TARGETARCH $TARGETVARIANT" && exit 1 ;; \
    esac && \
    cc -std=c99 test.c "$target/lib$NAME.a" -o test && \
    ./test && \
    cc -std=c99 -static loop.c "$target/lib$NAME.a" -o loop && \
    mkdir out && cp loop LICENSE "$NAME.toml" out && \
    if [ -f ardusub_sender.py ]; then cp ardusub_sender.py out; fi

FROM python:3.12-alpine AS gate
RUN pip install --no-cache-dir pymavlink

FROM ${BASE}
COPY --from=build /law/out/ /
LABEL version="0.1.0"
LABEL permissions='{"HostConfig": {"NetworkMode": "host"}}'
LABEL authors='[{"name": "YOUR NAME", "email": "you@example.org"}]'
LABEL company='{"name": "YOUR LABORATORY", "about": "", "email": "you@example.org"}'
LABEL readme="https://example.org/README.md"
LABEL links='{"source": "https://example.org"}'
LABEL type="other"
LABEL tags='["control"]'
LABEL requirements="core >= 1.1"
USER 65534:65534
ENTRYPOINT ["/loop", "9100"]
