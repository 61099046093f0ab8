// A client of the image stream that takes the bytes and does not parse them, for bench/stream.py --native: with a Python
// client its own cost hides the server's.
//
//   g++ -O2 -std=c++17 bench/stream_client.cc -o stream_client $(pkg-config --cflags --libs grpc++)
//   stream_client HOST:PORT SECONDS PAUSE

#include <grpcpp/grpcpp.h>
#include <grpcpp/support/sync_stream.h>
#include <grpcpp/support/byte_buffer.h>
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <thread>
#include <vector>

namespace {

double cpu() {
  rusage usage;
  getrusage(RUSAGE_SELF, &usage);
  return usage.ru_utime.tv_sec + usage.ru_stime.tv_sec + 1e-6 * (usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// Seconds since the timestamp in the first field of a set: Time{1: sec, 2: nsec} as varints.
double age(const grpc::ByteBuffer& buffer) {
  std::vector<grpc::Slice> slices;
  buffer.Dump(&slices);
  const unsigned char* data = slices[0].begin();
  double value[3] = {0, 0, 0};
  for (int i = 2, end = 2 + data[1]; i < end;) {
    const int field = data[i++] >> 3;
    unsigned long long number = 0;
    for (int shift = 0;; shift += 7) {
      number |= (data[i] & 0x7FULL) << shift;
      if (!(data[i++] & 0x80)) break;
    }
    if (field < 3) value[field] = static_cast<double>(number);
  }
  const auto system = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration<double>(system).count() - value[1] - 1e-9 * value[2];
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4) return 2;
  const double seconds = std::atof(argv[2]), pause = std::atof(argv[3]);
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(-1);
  auto channel = grpc::CreateCustomChannel(argv[1], grpc::InsecureChannelCredentials(), arguments);
  // ImageSetRequest: left, right, disparity, error and confidence enabled.
  const grpc::Slice fields("\x08\x01\x10\x01\x18\x01\x20\x01\x28\x01", 10);
  const grpc::ByteBuffer request(&fields, 1);
  grpc::internal::RpcMethod method("/ImageInterface/StreamImageSets", grpc::internal::RpcMethod::SERVER_STREAMING, channel);
  grpc::ClientContext context;
  auto* reader = grpc::internal::ClientReaderFactory<grpc::ByteBuffer>::Create(channel.get(), method, &context, request);
  grpc::ByteBuffer buffer;
  std::vector<double> ages;
  double begin = 0, cpu_begin = 0, bytes = 0, spent = 0;
  while (reader->Read(&buffer)) {
    if (ages.empty()) {
      std::puts("started");
      std::fflush(stdout);
      begin = now();
      cpu_begin = cpu();
    }
    ages.push_back(age(buffer));
    bytes += static_cast<double>(buffer.Length());
    spent = now() - begin;
    if (spent > seconds) break;
    if (pause > 0) std::this_thread::sleep_for(std::chrono::duration<double>(pause));
  }
  const double sets = static_cast<double>(ages.size());
  std::sort(ages.begin(), ages.end());
  std::printf("{\"sets\": %f, \"mb\": %f, \"cpu\": %f, \"age\": %f, \"slow\": %s}\n", (sets - 1) / spent,
              bytes * (sets - 1) / sets / spent / 1e6, (cpu() - cpu_begin) / spent, ages[ages.size() / 2] * 1e3,
              pause > 0 ? "true" : "false");
  std::fflush(stdout);
  std::_Exit(0);
}
